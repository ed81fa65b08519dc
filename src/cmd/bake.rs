//! `umbrage bake`: scene and lights in, container out.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::{Value, json};
use umbrage::format::Kind;
use umbrage::writer::bake::{BakeError, BakeOptions, Baked, Light, bake};
use umbrage::writer::container::Target;
use umbrage::writer::hierarchy::mmh;
use umbrage::writer::solid::Policy;

use super::output::{self, line};
use super::{
    Failure, TARGET, USAGE, Watched, layers, listen, load_scene_within, parse_numbers, parse_resolution, whole,
};

/// Arguments of `bake`.
#[derive(clap::Args)]
pub struct Args {
    /// city:SEED[:SIZE], forest:SEED[:SIZE], scan:SEED[:SIZE], or a .glb, .gltf, .obj or .ply file; or depth layers that
    /// an engine has rendered: an .exr file
    scene: String,
    /// The container to write
    #[arg(short, long, value_name = "FILE.umb")]
    output: PathBuf,
    /// A light that travels along X,Y,Z; repeat for several. For depth layers one, which may be NAME alone
    #[arg(long, required = true, value_name = "NAME=dir:X,Y,Z", value_parser = parse_light, allow_hyphen_values = true)]
    light: Vec<LightArg>,
    /// Texels on a side, a power of two up to 16777216; 16384 without it. Depth layers bring their own
    #[arg(long, allow_negative_numbers = true, value_parser = parse_resolution)]
    resolution: Option<u64>,
    /// How texels are encoded
    #[arg(long, default_value = "mh", value_parser = ["mh", "mmh", "vector"])]
    kind: String,
    /// Of kind mmh: subtrees that each one is held against, the nearest of its shape; 1000 without it
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>(0, u32::MAX.into()))]
    search: Option<u32>,
    /// How depth intervals come from geometry: closed, one-sided, thickness:T, second-surface or auto
    #[arg(long, default_value = "auto")]
    policy: Policy,
    /// exhaustive looks at every texel, for comparison
    #[arg(long, default_value = "proofs", value_parser = ["proofs", "exhaustive"])]
    builder: String,
    /// How kinds mh and mmh choose the value of a node: bottom-up from its four children, as mh does without it, or
    /// top-down from all texels of a tile of 256 x 256, as mmh does
    #[arg(long, value_parser = ["bottom-up", "top-down"])]
    values: Option<String>,
    /// Store pages in a shorter form that is decoded when they are loaded; answers are the same
    #[arg(long)]
    cold: bool,
    /// Most memory to hold, MiB
    #[arg(long, value_name = "MIB", allow_negative_numbers = true, value_parser = whole::<u64>(0, 1 << 40))]
    memory: Option<u64>,
    /// Threads, at most 1024; as many as there are cores without it
    #[arg(long, allow_negative_numbers = true, value_parser = parse_threads)]
    threads: Option<usize>,
    #[command(flatten)]
    layers: layers::LayerArgs,
    #[command(flatten)]
    placement: layers::PlacementArgs,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// A light, whose direction depth layers may leave out.
#[derive(Clone, Debug)]
pub struct LightArg {
    /// Its name.
    pub name: String,
    /// Where it travels.
    pub direction: Option<[f64; 3]>,
}

/// `NAME=dir:X,Y,Z` or `NAME`
fn parse_light(s: &str) -> Result<LightArg, String> {
    if s.chars().any(char::is_control) {
        return Err(format!("expected a name that can be printed in a line, found {s:?}"));
    }
    if !s.is_empty() && !s.contains(['=', ':', ',']) {
        return Ok(LightArg { name: s.to_string(), direction: None });
    }
    let parts = s.split_once('=').and_then(|(name, rest)| Some((name, rest.strip_prefix("dir:")?)));
    let (name, direction) = parts.ok_or_else(|| format!("expected NAME=dir:X,Y,Z, found '{s}'"))?;
    let direction = parse_numbers::<3>(direction)?;
    if direction == [0.0; 3] {
        return Err("the direction is 0; give the way the light travels, for example sun=dir:0.4,-0.8,0.3".to_string());
    }
    Ok(LightArg { name: name.to_string(), direction: Some(direction) })
}

/// More threads than this only wait for each other.
fn parse_threads(s: &str) -> Result<usize, String> {
    match s.parse() {
        Ok(n @ 1..=1024) => Ok(n),
        _ => Err(format!("expected 1 to 1024, found '{s}'")),
    }
}

/// A pool of so many threads.
pub fn pool(threads: Option<usize>) -> Result<rayon::ThreadPool, Failure> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|e| Failure::new(TARGET, format!("threads: {e}; ask for fewer with --threads")))
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    if args.kind == "vector" && args.builder == "exhaustive" {
        return Err(Failure::new(USAGE, "--builder exhaustive is for --kind mh; leave one of them out"));
    }
    if args.kind != "mmh" && args.search.is_some() {
        return Err(Failure::new(USAGE, "--search is for --kind mmh; leave one of them out"));
    }
    let top_down = args.values.as_ref().map_or(args.kind == "mmh", |v| v == "top-down");
    if args.values.is_some() && (args.kind == "vector" || layers::are(&args.scene)) {
        return Err(Failure::new(USAGE, "--values is for geometry and --kind mh or mmh; leave it out"));
    }
    if layers::are(&args.scene) {
        if args.kind != "mh" {
            let (kind, scene) = (&args.kind, &args.scene);
            return Err(Failure::new(
                USAGE,
                format!("--kind {kind} needs geometry; {scene} is depth layers: use --kind mh"),
            ));
        }
        let light = layers::one_light(&args.light)?;
        let bake = layers::Bake {
            first: args.scene.into(),
            output: args.output,
            light,
            resolution: args.resolution,
            policy: args.policy,
            memory_bytes: args.memory.map(|m| m.saturating_mul(1 << 20)),
            threads: args.threads,
            cold: args.cold,
            json: args.json,
        };
        return layers::run(bake, args.layers, args.placement);
    }
    if let Some(option) = args.layers.given().or(args.placement.given()) {
        return Err(Failure::new(USAGE, format!("{option} is for depth layers; {} is a scene", args.scene)));
    }
    let light = |l: LightArg| {
        let name = l.name;
        match l.direction {
            Some(direction) => Ok(Light { name, direction }),
            None => Err(Failure::new(USAGE, format!("light '{name}': expected NAME=dir:X,Y,Z, found no direction"))),
        }
    };
    let lights = args.light.into_iter().map(light).collect::<Result<Vec<_>, _>>()?;
    let start = Instant::now();
    // Made and removed: a target that can't be written is found before the work, not after it.
    drop(Target::create(&args.output).map_err(BakeError::from)?);
    let pool = pool(args.threads)?;
    let memory_bytes = args.memory.map(|m| m.saturating_mul(1 << 20));
    let mesh = pool.install(|| load_scene_within(&args.scene, memory_bytes))?;
    let load = start.elapsed().as_secs_f64();
    let options = BakeOptions {
        lights,
        resolution: args.resolution.unwrap_or(16384),
        policy: args.policy,
        kind: match args.kind.as_str() {
            "vector" => Kind::Vector,
            "mmh" => Kind::Mmh,
            _ => Kind::Mh,
        },
        top_down,
        mmh: args.search.map_or_else(Default::default, |search| mmh::Options { search }),
        exhaustive: args.builder == "exhaustive",
        memory_bytes,
        cold: args.cold,
    };
    let texels = options.resolution.saturating_mul(options.resolution).saturating_mul(options.lights.len() as u64);
    let watched = Watched::start(texels);
    let baked = pool.install(|| bake(&mesh, &options, &args.output, &watched.progress))?;
    drop(watched);
    let total = start.elapsed().as_secs_f64();
    if args.json {
        return line(&report(&baked, &options, load, total).to_string());
    }
    for l in &baked.lights {
        let (all, c) = ((options.resolution as f64).powi(2), &l.counts);
        line(&format!(
            "light {}: {} nodes in {} pages, {:.3} % edge texels, {} thin texels, vertices moved by at most {:.2e}",
            l.name,
            l.nodes.iter().sum::<u64>(),
            l.pages,
            c.edge_texels as f64 / all * 100.0,
            c.thin_texels,
            l.displacement
        ))?;
        let k = &l.components;
        line(&format!(
            "  components: {} closed ({} turned inside out, {} cavities), {} open with {} boundary edges",
            k.closed, k.flipped, k.cavities, k.open, k.boundary_edges
        ))?;
        if k.open > 0 && matches!(options.policy, Policy::Auto | Policy::OneSided) {
            line(
                "  open ones are sheets without thickness: shadows near them need a bias; --policy second-surface is \
                 right on the scene's own surfaces, --policy thickness:T for walls at least T thick",
            )?;
        }
    }
    line(&format!(
        "{} in {total:.1} s (load {load:.1}, snap {:.1}, build {:.1}, write {:.1}), peak memory {}",
        output::bytes(baked.bytes),
        baked.seconds.snap,
        baked.seconds.build,
        baked.seconds.write,
        output::mib(output::peak_memory())
    ))?;
    line(&args.output.display().to_string())
}

/// The figures of a bake; sums over all lights.
pub fn report(baked: &Baked, options: &BakeOptions, load: f64, total: f64) -> Value {
    let sum = |f: &dyn Fn(&umbrage::writer::bake::LightReport) -> u64| baked.lights.iter().map(f).sum::<u64>();
    let s = &baked.seconds;
    json!({
        "resolution": options.resolution,
        "triangles": baked.triangles,
        "nodes": sum(&|l| l.nodes.iter().sum()),
        "pages": sum(&|l| l.pages),
        "bytes": baked.bytes,
        "edge_texels": sum(&|l| l.counts.edge_texels),
        "thin_texels": sum(&|l| l.counts.thin_texels),
        "texels_evaluated": sum(&|l| l.counts.texels_evaluated),
        "peak_memory_bytes": output::peak_memory(),
        "seconds": {"load": load, "snap": s.snap, "build": s.build, "write": s.write, "total": total},
        "lights": baked.lights.iter().map(|l| json!({
            "name": l.name,
            "leaf_nodes": l.nodes[0], "inner_nodes": l.nodes[1], "empty_nodes": l.nodes[2],
            "edge_texels": l.counts.edge_texels,
            "thin_texels": l.counts.thin_texels,
            "displacement": l.displacement,
            "components": {
                "closed": l.components.closed, "open": l.components.open,
                "boundary_edges": l.components.boundary_edges, "flipped": l.components.flipped,
                "cavities": l.components.cavities, "collapsed_triangles": l.components.collapsed,
            },
            "merge": l.merged.as_ref().map(merged),
            "texels": {
                "proven": l.counts.effort.proven, "refuted": l.counts.effort.refuted,
                "divided": l.counts.effort.divided, "exact_squares": l.counts.effort.exact,
            },
        })).collect::<Vec<_>>(),
    })
}

/// What merging did, for programs: tables 2.6 to 2.8 of Scandolo 2019.
fn merged(r: &mmh::Report) -> Value {
    let pairs =
        r.pairs.iter().enumerate().skip(1).map(
            |(height, p)| json!({ "height": height, "merged": p.merged, "intervals": p.intervals, "nodes": p.nodes }),
        );
    json!({
        "words": r.words_before, "words_merged": r.words_merged, "words_paged": r.words_paged,
        "shared_pages": r.shared_pages, "dependencies": r.dependencies[0], "most_dependencies": r.dependencies[1],
        "pairs": pairs.collect::<Vec<_>>(), "seconds": { "match": r.seconds[0], "pages": r.seconds[1] },
    })
}
