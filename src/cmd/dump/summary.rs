//! Figures of a whole file. The JSON is made first, and people get their lines from it: one truth.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use umbrage::format::kind::vector::Header;
use umbrage::format::{Kind, SectionRecord, StructureRecord};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, Structure};
use umbrage::writer::bake::policy_of;

use super::super::output::{bytes, line};
use super::super::{Failure, go_on};
use super::mmh::Walker;
use super::vector::{self, SECTIONS};

/// Everything about the file, or about one light.
pub fn of(container: &Container, light: Option<&str>) -> Result<Value, Failure> {
    let h = container.header();
    let id: String = container.file_id().iter().map(|b| format!("{b:02x}")).collect();
    let lights = container.structures().filter(|s| light.is_none_or(|n| n == s.name()));
    let lights = lights.map(|s| structure(&s)).collect::<Result<Vec<_>, _>>()?;
    let tables = umbrage::format::Header::BYTES + container.sections().len() * SectionRecord::BYTES;
    let records = container.structure_count() as usize * StructureRecord::BYTES;
    Ok(json!({
        "file": container.file().to_string(),
        "bytes": h.total_bytes.get(),
        "version": format!("{}.{}", h.version_major.get(), h.version_minor.get()),
        "file_id": id,
        "page_alignment": h.alignment(),
        "structures": container.structure_count(),
        "bytes_of_header_and_records": tables + records,
        "lights": lights,
    }))
}

fn structure(s: &Structure) -> Result<Value, Failure> {
    let (r, l) = (s.record(), s.lattice());
    let side = u64::from(l.resolution());
    let nodes = [r.leaf_nodes.get(), r.inner_nodes.get(), r.empty_nodes.get()];
    let index = u64::from(s.block_count()) * r.block_bytes();
    let (mut levels, mut words, mut dependencies) = (BTreeMap::<u8, u64>::new(), 0, 0);
    let (mut largest, mut first, mut end, mut pad) = (0, 0, None, 0);
    // Of cold pages: how many, what they take, what they are decoded to.
    let (mut cold_pages, mut cold, mut hot) = (0u64, 0u64, 0u64);
    let (mut sections, mut palette) = ([0u64; SECTIONS.len()], Palette::default());
    for ordinal in 0..s.page_count() {
        if !go_on() {
            return Err(Failure::interrupted());
        }
        let p = s.page_record(ordinal)?;
        if !p.is_shared() {
            *levels.entry(p.level_coarsest).or_default() += 1;
        }
        let own = u64::from(p.hot_words.get());
        words += own;
        largest = largest.max(own * 4);
        dependencies += u64::from(p.dep_count.get());
        pad += end.map_or(0, |e: u64| p.offset.get().saturating_sub(e));
        end = Some(p.end());
        if ordinal == 0 {
            first = p.stored_bytes();
        }
        if p.cold_words.get() != 0 {
            cold_pages += 1;
            cold += p.stored_bytes();
            hot += own * 4;
        }
        if s.kind() == Kind::Vector {
            let page = s.page(ordinal)?;
            sections.iter_mut().zip(vector::sections(&page)).for_each(|(sum, n)| *sum += n);
            palette.add(&Header::decode(page.words()));
        }
    }
    let pages = u64::from(s.page_count());
    let model = s.cold_section().map_or(0, |section| section.length.get());
    let total = index + words * 4 - hot + cold + model + pad + StructureRecord::BYTES as u64;
    let root = &r.root_page;
    let texel = |row: [f64; 4]| {
        let steps = (row[0] * row[0] + row[1] * row[1] + row[2] * row[2]).sqrt();
        2f64.powi(l.subtexel_bits.into()) / steps
    };
    let depth = l.world_to_lattice[2];
    let mut parts = json!({
        "total": total, "index": index, "alignment": pad, "record": StructureRecord::BYTES,
    });
    let own: Vec<(&str, u64)> = match s.kind() {
        Kind::Vector => SECTIONS.into_iter().zip(sections.map(|words| words * 4)).collect(),
        _ => {
            let nodes = [("leaf_nodes", nodes[0] * 4), ("inner_nodes", nodes[1] * 8), ("empty_nodes", nodes[2] * 4)];
            nodes.into_iter().chain([("frames", pages * 8)]).collect()
        }
    };
    own.into_iter().for_each(|(name, n)| parts[name] = n.into());
    let mut summary = json!({
        "name": s.name(),
        "kind": s.kind().name(),
        "resolution": side,
        "texel_world": [texel(l.world_to_lattice[0]), texel(l.world_to_lattice[1])],
        "depth_step_world": 1.0 / (depth[0] * depth[0] + depth[1] * depth[1] + depth[2] * depth[2]).sqrt(),
        "light_direction": r.light_direction.map(|c| c.get()),
        "policy": policy_of(r).map_or_else(|| r.policy_words().to_string(), |p| p.to_string()),
        "guarantee": r.guarantee_words(),
        "from_layers": r.is_from_layers(),
        "edge_texels": r.edge_texels.get(), "thin_texels": r.thin_texels.get(),
        "depth_min": root.min_depth.get(), "depth_max": root.max_depth.get(), "depth_guard": r.depth_guard.get(),
        "triangles": r.triangles.get(), "snap_displacement_world": r.snap_displacement.get(),
        "nodes": {"leaf": nodes[0], "inner": nodes[1], "empty": nodes[2]},
        "pages": pages, "shared_pages": r.shared_pages.get(), "dependencies": dependencies,
        "index_blocks": s.block_count(),
        "largest_page_bytes": largest,
        "first_look_bytes": 16384 + first,
        "pages_by_level": levels.iter().rev().map(|(k, n)| json!({"level": k, "pages": n})).collect::<Vec<_>>(),
        "bytes": parts,
        "cold": {"pages": cold_pages, "bytes": cold, "hot_bytes": hot, "model_bytes": model},
        "uncompressed_bytes": side * side * 4 * u64::from(r.root_count.get()),
    });
    match s.kind() {
        Kind::Vector => summary["palette"] = palette.json(),
        Kind::Mmh => summary["sharing"] = sharing(s)?,
        _ => summary["value_bits"] = json!({"32": nodes[0] + nodes[1]}),
    }
    Ok(summary)
}

/// Nodes as lookups meet them, and references by where they lead, of a structure of kind `mmh`.
fn sharing(s: &Structure) -> Result<Value, Failure> {
    let map = Map::new(s.clone())?;
    let (mut walker, mut met) = (Walker::new(&map), 0u64);
    for ordinal in 0..s.record().tree_pages() {
        if !go_on() {
            return Err(Failure::interrupted());
        }
        met = met.saturating_add(walker.page(ordinal)?);
    }
    let [here, shared] = walker.references;
    Ok(json!({ "nodes_met": met, "references_in_page": here, "references_to_shared_pages": shared }))
}

/// How much the palettes of all pages hold.
#[derive(Default)]
struct Palette {
    lines: u64,
    constants: u64,
    planes: u64,
    splits: u64,
    masks: u64,
    raws: u64,
}

impl Palette {
    fn add(&mut self, h: &Header) {
        self.lines += u64::from(h.lines);
        self.constants += u64::from(h.constants);
        self.planes += u64::from(h.planes);
        self.splits += u64::from(h.splits);
        self.masks += u64::from(h.masks);
        self.raws += u64::from(h.raws);
    }

    fn json(&self) -> Value {
        json!({
            "lines": self.lines, "constants": self.constants, "planes": self.planes, "splits": self.splits,
            "masks": self.masks, "raws": self.raws,
        })
    }
}

/// Lines for people.
pub fn print(v: &Value) -> Result<(), Failure> {
    line(&format!(
        "{}: {}, format {}, {} light{}, id {}",
        v["file"].as_str().unwrap_or_default(),
        bytes(number(&v["bytes"])),
        v["version"].as_str().unwrap_or_default(),
        v["structures"],
        if v["structures"] == 1 { "" } else { "s" },
        v["file_id"].as_str().unwrap_or_default()
    ))?;
    v["lights"].as_array().into_iter().flatten().try_for_each(print_light)
}

fn number(v: &Value) -> u64 {
    v.as_u64().unwrap_or(0)
}

fn print_light(l: &Value) -> Result<(), Failure> {
    let text = |key: &str| l[key].as_str().unwrap_or_default();
    let real = |v: &Value| v.as_f64().unwrap_or(0.0);
    let side = number(&l["resolution"]);
    let d = &l["light_direction"];
    line("")?;
    line(&format!("light '{}', kind {}", text("name"), text("kind")))?;
    let row = |name: &str, text: String| line(&format!("  {name:<12}{text}"));
    row(
        "map",
        format!(
            "{side} x {side} texels of {:.3e} x {:.3e} world units, light along {:.4}, {:.4}, {:.4}",
            real(&l["texel_world"][0]),
            real(&l["texel_world"][1]),
            real(&d[0]),
            real(&d[1]),
            real(&d[2])
        ),
    )?;
    let b = &l["bytes"];
    let (total, plain) = (number(&b["total"]), number(&l["uncompressed_bytes"]));
    row(
        "size",
        format!("{}, uncompressed {}: {:.1} to 1", bytes(total), bytes(plain), plain as f64 / total.max(1) as f64),
    )?;
    let edge = number(&l["edge_texels"]);
    let share = edge as f64 / (side as f64).powi(2) * 100.0;
    row("policy", text("policy").to_string())?;
    row("right for", text("guarantee").to_string())?;
    if l["from_layers"] == true {
        row("edges", format!("all texels: depths are known at their centres only; {} thin", l["thin_texels"]))?;
    } else {
        row("edges", format!("{edge} edge texels ({share:.3} %), {} of them thin", l["thin_texels"]))?;
    }
    row(
        "depths",
        format!(
            "{} to {} of {:.3e} world units, guard {}",
            l["depth_min"],
            l["depth_max"],
            real(&l["depth_step_world"]),
            l["depth_guard"]
        ),
    )?;
    let moved = real(&l["snap_displacement_world"]);
    row(
        "source",
        match l["from_layers"] == true {
            true => "depth layers".to_string(),
            false => {
                format!("{} triangles, vertices moved by at most {moved:.2e} world units", l["triangles"])
            }
        },
    )?;
    let n = &l["nodes"];
    let nodes = number(&n["leaf"]) + number(&n["inner"]) + number(&n["empty"]);
    row(
        "nodes",
        format!(
            "{nodes}: {} leaves, {} inner, {} empty; {:.2} bytes each in all",
            n["leaf"],
            n["inner"],
            n["empty"],
            total as f64 / nodes.max(1) as f64
        ),
    )?;
    if let Some(palette) = l["palette"].as_object() {
        let sizes: Vec<String> = palette.iter().map(|(name, n)| format!("{n} {name}")).collect();
        row("palette", sizes.join(", "))?;
    }
    if let Some(sharing) = l["sharing"].as_object() {
        row(
            "sharing",
            format!(
                "{} nodes as lookups meet them: {:.2} for each that is stored; {} references within pages, {} to shared ones, {} dependencies",
                sharing["nodes_met"],
                number(&sharing["nodes_met"]) as f64 / nodes.max(1) as f64,
                sharing["references_in_page"],
                sharing["references_to_shared_pages"],
                l["dependencies"]
            ),
        )?;
    }
    let nodes = [("leaves", "leaf_nodes"), ("inner", "inner_nodes"), ("empty", "empty_nodes"), ("frames", "frames")];
    let own = if l["palette"].is_object() { SECTIONS.map(|name| (name, name)).to_vec() } else { nodes.to_vec() };
    let parts = own.into_iter().chain([("index", "index"), ("alignment", "alignment")]);
    let parts: Vec<String> = parts.map(|(name, key)| format!("{name} {}", bytes(number(&b[key])))).collect();
    row("bytes", parts.join(", "))?;
    let c = &l["cold"];
    if number(&c["model_bytes"]) > 0 {
        row(
            "cold",
            format!(
                "{} pages of {} stored in {}, with a model of {}: {:.3} of these bytes",
                c["pages"],
                bytes(number(&c["hot_bytes"])),
                bytes(number(&c["bytes"])),
                bytes(number(&c["model_bytes"])),
                (number(&c["bytes"]) + number(&c["model_bytes"])) as f64 / number(&c["hot_bytes"]).max(1) as f64
            ),
        )?;
    }
    row(
        "pages",
        format!(
            "{} of at most {}, {} shared; index of {} blocks; first look {}",
            l["pages"],
            bytes(number(&l["largest_page_bytes"])),
            l["shared_pages"],
            l["index_blocks"],
            bytes(number(&l["first_look_bytes"]))
        ),
    )?;
    let levels: Vec<String> = l["pages_by_level"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|p| format!("{}: {}", p["level"], p["pages"]))
        .collect();
    row("by level", levels.join(", "))
}
