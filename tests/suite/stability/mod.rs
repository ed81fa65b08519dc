//! Numerical attacks: inputs made to break the bake, both kinds, held texel by texel against the exact oracle and against
//! plain rays. `UMBRAGE_SEEDS` sets how many random scenes are tried; where it is set, every attack is also baked at
//! every resolution.

#[allow(dead_code, reason = "the the benchmark uses all of it")]
pub mod attack;

use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use attack::probe::{Case, Found, bake_to, hold, probe};
use attack::shapes::*;
use attack::{ATTACKS, Attack, KINDS, LIGHTS};
use rayon::prelude::*;
use umbrage::certify::Oracle;
use umbrage::format::Kind;
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::bake::BakeError;
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{Policy, SolidError, snap};

/// A folder of one test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("umbrage-stability-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn probe(&self, name: &str, mesh: &Mesh, case: &Case) -> Result<Found, BakeError> {
        let Case { kind, policy, light: [x, y, z], resolution, .. } = case;
        let file = format!("{name}-{kind:?}-{policy}-{x}-{y}-{z}-{resolution}.umb").replace(['/', ' '], "_");
        probe(mesh, case, &self.0.join(file))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Random scenes to try, if the environment says.
fn seeds() -> Option<u64> {
    std::env::var("UMBRAGE_SEEDS").ok().and_then(|s| s.parse().ok())
}

/// In long runs: which attacks, by a part of their names; without it all, and counts are of all of them.
fn only() -> String {
    std::env::var("UMBRAGE_ATTACK").unwrap_or_default()
}

/// In long runs at 65,536: which light of `LIGHTS`, by its place; without it the first four. A map can take minutes, and a run be cut short.
fn light() -> Option<usize> {
    std::env::var("UMBRAGE_LIGHT").ok().and_then(|s| s.parse().ok())
}

/// What is tried of an attack: a light and sides of maps.
type Part = ([f64; 3], Vec<u64>);

/// Bakes parts of all attacks and adds up; `parts` is asked with the attack's number.
fn all_attacks(name: &str, points: u32, parts: impl Fn(usize) -> Vec<Part> + Sync) -> Found {
    each_attack(name, |folder, i, attack, told| {
        let mut all = Found::default();
        for (light, sides) in parts(i) {
            all.add(attack.run(light, &sides, points, &|mesh, case| folder.probe(attack.name, mesh, case)));
            told(&format!("light {light:?}"), &all);
        }
        all
    })
}

/// Does `one` with all attacks and adds up; it is given the attack's number, and tells how far it is.
fn each_attack(name: &str, one: impl Fn(&Folder, usize, &Attack, &dyn Fn(&str, &Found)) -> Found + Sync) -> Found {
    let folder = Folder::new(name);
    let only = only();
    let one = |(i, attack): (usize, &Attack)| {
        if !attack.name.contains(&only) {
            return Found::default();
        }
        let start = Instant::now();
        one(&folder, i, attack, &|what, all| {
            if seeds().is_some() {
                let (name, seconds) = (attack.name, start.elapsed().as_secs());
                eprintln!("{name}, {what}: {seconds} s, {} outside, {} wrong", all.outside, all.wrong);
            }
        })
    };
    let found: Vec<Found> = ATTACKS.par_iter().enumerate().map(one).collect();
    let mut all = Found::default();
    found.into_iter().for_each(|f| all.add(f));
    assert_eq!((all.outside, all.wrong, &all.faults[..]), (0, 0, &[][..]));
    all
}

#[test]
fn every_attack_is_right_under_every_light() {
    let found = all_attacks("lights", 48, |attack| {
        let sides = |light: usize| match seeds() {
            Some(_) => (0..8).map(|log2| 1 << log2).collect(),
            None => vec![1 << ((attack + light) % 8)],
        };
        LIGHTS.into_iter().enumerate().map(|(i, light)| (light, sides(i))).collect()
    });
    assert!(
        !only().is_empty() || (found.texels > 1_000_000 && found.receivers > 100_000 && found.certified() > 500_000),
        "{found:?}"
    );
    // nothing of the deep scene is left from the side
    assert!(!only().is_empty() || found.refused > 0);
}

#[test]
fn larger_maps_of_every_attack_are_right_texel_by_texel() {
    let found = all_attacks("larger", 200, |attack| match seeds() {
        Some(_) => LIGHTS.map(|light| (light, vec![256, 512, 1024])).to_vec(),
        None => vec![(LIGHTS[attack % 2], vec![256 << (attack % 3)])],
    });
    assert!(!only().is_empty() || (found.texels > 20_000_000 && found.receivers > 100_000), "{found:?}");
}

/// Sheets thinner than a texel is deep leave each texel a value of its own: at 65,536 that is hours for one map, and many GB in
/// kind `mh`. What takes more than this there at 2,048 texels a side is tried at 4,096.
const EACH_TEXEL_BYTES: u64 = 1 << 19;
/// Level plates that coincide or are thinner than a step of depth, under a light from straight above, have one value but no
/// certified texel: each is looked at. What would take longer than this at 65,536, as its growth from 2,048 to 4,096 says, is tried
/// at 4,096, too; one attack at a time (`UMBRAGE_ATTACK`), since times are those of a pool that all share.
const EACH_TEXEL_SECONDS: f64 = 600.0;

#[test]
fn samples_of_maps_of_65536_are_right() {
    let found = each_attack("huge", |folder, i, attack, told| {
        let lights = match (seeds(), light(), attack.name) {
            (Some(_), Some(at), _) => &LIGHTS[at..][..1],
            (Some(_), None, _) => &LIGHTS[..4],
            (None, _, "one triangle" | "far away") => &LIGHTS[i % 2..][..1],
            _ => &[],
        };
        let probe = |mesh: &Mesh, case: &Case| folder.probe(attack.name, mesh, case);
        let mut all = Found::default();
        for &light in lights {
            for policy in attack.policies() {
                let run = |kind, side, points| attack.run_as(kind, policy, light, &[side], points, &probe);
                let timed = |side| {
                    let begin = Instant::now();
                    (run(Kind::Mh, side, 0).bytes, begin.elapsed().as_secs_f64())
                };
                let each_texel = || {
                    let (bytes, short) = timed(2048);
                    if bytes > EACH_TEXEL_BYTES {
                        return true;
                    }
                    let (_, long) = timed(4096);
                    // An area's times grow by 4, a line's by 2.
                    long * (long / short).clamp(1.0, 4.0).powi(4) > EACH_TEXEL_SECONDS
                };
                // The two of the short run are known not to be.
                let side = if seeds().is_some() && each_texel() { 4096 } else { 1 << 16 };
                for kind in KINDS {
                    all.add(run(kind, side, 250));
                    told(&format!("light {light:?}, {policy}, {side}, {kind:?}"), &all);
                }
            }
        }
        all
    });
    assert!(!only().is_empty() || (found.texels > 10_000 && found.receivers > 5_000), "{found:?}");
}

#[test]
fn random_solids_are_right() {
    let folder = Folder::new("random");
    let one = |seed: u64| {
        let open = seed % 3 == 2;
        let mesh = solids(seed, open);
        let policies: &[Policy] = match open {
            true => &[Policy::Auto, Policy::OneSided, Policy::SecondSurface, Policy::Thickness(0.07)],
            false => &[Policy::Closed, Policy::SecondSurface],
        };
        let mut d = Dice::new(!seed);
        let light = match seed % 4 {
            0 => [d.signed(), d.signed(), d.signed()],
            _ => LIGHTS[d.below(LIGHTS.len() as u64) as usize],
        };
        let mut all = Found::default();
        for (i, &policy) in policies.iter().enumerate() {
            let log2 = (seed + 3 * i as u64) % if seed.is_multiple_of(8) { 11 } else { 8 };
            for kind in KINDS {
                let case = Case { kind, policy, light, resolution: 1 << log2, points: 64 };
                match folder.probe(&seed.to_string(), &mesh, &case) {
                    Ok(found) => all.add(found),
                    // needle-like shapes seen from their ends may have no area left
                    Err(BakeError::Solid(SolidError::Flat { .. })) => all.refused += 1,
                    Err(e) => all.faults.push(format!("{case:?}: {e}")),
                }
            }
        }
        all.faults.iter_mut().for_each(|f| *f = format!("seed {seed}, {f}"));
        all
    };
    let seeds = seeds().unwrap_or(64);
    let found: Vec<Found> = (0..seeds).into_par_iter().map(one).collect();
    let mut all = Found::default();
    found.into_iter().for_each(|f| all.add(f));
    assert_eq!((all.outside, all.wrong, &all.faults[..]), (0, 0, &[][..]));
    assert!(all.receivers > 100 * seeds && all.certified() > 1000 * seeds && all.refused < seeds, "{all:?}");
}

/// A check that finds nothing proves nothing.
#[test]
fn a_map_of_another_scene_is_found_wrong() {
    let folder = Folder::new("other");
    let file = folder.0.join("map.umb");
    let scene = |height: f64| union([block([0.0; 3], [1.0, 0.1, 1.0]), block([0.2, height, 0.1], [0.3, 0.1, 0.4])]);
    for kind in KINDS {
        let case = Case { kind, policy: Policy::Closed, light: LIGHTS[0], resolution: 64, points: 2000 };
        bake_to(&scene(0.5), &case, &file).unwrap();
        let (own, other) = (hold(&scene(0.5), &case, &file), hold(&scene(0.65), &case, &file));
        assert_eq!((own.outside, own.wrong, &own.faults[..]), (0, 0, &[][..]));
        assert!(other.outside > 100 && other.wrong > 10 && !other.faults.is_empty(), "{other:?}");
    }
}

#[test]
fn what_no_lattice_holds_is_refused_with_a_reason() {
    let folder = Folder::new("refused");
    for refused in attack::refused::refused() {
        for kind in KINDS {
            let message = refused.bake(kind, &folder.0.join("no.umb")).expect_err(refused.name).to_string();
            assert!(message.contains(refused.words), "{}: {message}", refused.name);
            assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 0, "{} left a file", refused.name);
        }
    }
}

/// Meshes that hardly are any.
fn degenerate() -> Vec<(&'static str, Mesh)> {
    let [a, b, c] = [[-1.0, 0.0, -0.9], [1.0, 0.1, -0.2], [0.3, 0.8, 1.0]];
    let good = [a, b, c];
    let upright = |x: f64| [[x, 0.0, 0.0], [x, 1.0, 0.2], [x, 0.3, 1.0]];
    let between = |t: f64| [0, 1, 2].map(|k| a[k] + t * (b[k] - a[k]));
    let own = block([0.0; 3], [0.5, 0.3, 0.7]);
    let twice = |mesh: &Mesh| Mesh { triangles: [&mesh.triangles[..]; 2].concat(), ..mesh.clone() };
    vec![
        ("one triangle", triangles(&[good])),
        ("one triangle, turned over", triangles(&[[a, c, b]])),
        ("one triangle many times", triangles(&[good; 40])),
        ("a triangle and its back", triangles(&[good, [a, c, b]])),
        ("one of no area", triangles(&[[a, b, between(0.3)]])),
        ("only such as have no area", triangles(&[[a, a, a], [a, b, b], [a, b, between(0.7)], [b, a, between(0.1)]])),
        ("all edge-on", triangles(&[upright(0.0), upright(0.5), upright(0.5), upright(-0.25)])),
        ("edge-on, and a sliver", triangles(&[upright(0.0), [[0.0; 3], [1e-12, 1.0, 0.0], [1e-12, 0.0, 1.0]]])),
        ("a box twice", twice(&own)),
        ("a box inside out", flipped(own.clone())),
        ("a flat box", block([0.0; 3], [0.5, 0.0, 0.7])),
        ("a flat box, edge-on", block([0.0; 3], [0.0, 0.5, 0.7])),
        ("a box and a vertex that nothing uses", {
            let mut mesh = own.clone();
            mesh.positions.push([1e6, -1e6, 1e6]);
            mesh
        }),
        ("a flat tetrahedron", tetrahedron([a, b, c, [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0)])),
        ("a fan that folds back", triangles(&[good, [b, a, [0.2, 0.9, 0.9]], [a, b, [0.4, -0.7, 0.8]], [b, a, c]])),
    ]
}

#[test]
fn degenerate_input_never_panics_nor_hangs_and_is_right_or_refused() {
    let (done, all_done) = mpsc::channel();
    // a bake that hangs can't be joined
    let worker = std::thread::spawn(move || {
        let folder = Folder::new("degenerate");
        let policies = [
            Policy::Closed,
            Policy::OneSided,
            Policy::Auto,
            Policy::SecondSurface,
            Policy::Thickness(1e-9),
            Policy::Thickness(0.3),
            Policy::Thickness(1e9),
        ];
        let mut all = Found::default();
        for (name, mesh) in degenerate() {
            for (i, &policy) in policies.iter().enumerate() {
                for (j, &light) in LIGHTS.iter().enumerate() {
                    for kind in KINDS {
                        let case = Case { kind, policy, light, resolution: 1 << ((i + j) % 6), points: 16 };
                        match folder.probe(name, &mesh, &case) {
                            Ok(found) => all.add(found),
                            Err(BakeError::Solid(SolidError::Flat { .. } | SolidError::Open { .. })) => {
                                all.refused += 1
                            }
                            Err(e) => all.faults.push(format!("{name}: {case:?}: {e}")),
                        }
                    }
                }
            }
        }
        done.send(all)
    });
    let all = match all_done.recv_timeout(Duration::from_secs(300)) {
        Ok(all) => all,
        Err(mpsc::RecvTimeoutError::Timeout) => panic!("a bake hangs"),
        Err(mpsc::RecvTimeoutError::Disconnected) => panic!("a bake panicked: {:?}", worker.join().err()),
    };
    assert_eq!((all.outside, all.wrong, &all.faults[..]), (0, 0, &[][..]));
    assert!(all.refused > 100 && all.texels > 100_000 && all.receivers > 1000, "{all:?}");
}

/// Found by `open joints`: a sliver nearly edge-on rises by 2^32 steps of depth and more within a texel of a small map,
/// while its rise over the map stays in bounds. Its gradient had more bits than a page holds.
#[test]
fn planes_too_steep_for_a_page_are_not_stored() {
    let folder = Folder::new("steep");
    let mesh = Mesh {
        positions: vec![
            [-0.69, -0.2, -1.0],
            [-0.11, -0.13, -0.84],
            [0.49, -0.65, -0.84],
            [0.54, 0.63, -0.4],
            [1.15, 0.11, -0.4],
            [0.1, 0.12, -0.69],
            [0.9, -0.6, 0.95],
            [-0.9, -0.8, -0.1],
        ],
        triangles: vec![[1, 4, 2], [5, 3, 4]],
    };
    let mut all = Found::default();
    for log2 in 0..8 {
        let (kind, policy, light) = (KINDS[1], Policy::Thickness(0.1), [0.6, -0.8, 0.0]);
        let case = Case { kind, policy, light, resolution: 1 << log2, points: 100 };
        all.add(folder.probe("steep", &mesh, &case).unwrap());
    }
    assert_eq!((all.outside, all.wrong, &all.faults[..]), (0, 0, &[][..]));
    assert!(all.texels > 20_000 && all.edge > 100 && all.receivers > 100, "{all:?}");
}

/// Found by `open joints`: two cuts of a square ran less than 2^-18 texel apart, and three texels held parts of the cells on
/// both sides of them. Each of these was right in the cell between them, whose border with either had been looked at; their own
/// border had no length and was taken for none.
#[test]
fn texels_wider_than_the_cell_between_two_others_are_right() {
    let attack = ATTACKS.iter().find(|a| a.name == "open joints").unwrap();
    let (folder, mesh) = (Folder::new("sliver"), (attack.mesh)());
    let target = folder.0.join("sliver.umb");
    let (kind, policy, light) = (KINDS[1], Policy::Thickness(0.1), LIGHTS[0]);
    bake_to(&mesh, &Case { kind, policy, light, resolution: 1024, points: 0 }, &target).unwrap();
    let file = Container::open(Arc::new(FileSource::open(&target).unwrap()), Limits::default()).unwrap();
    let map = Map::new(file.structure(0).unwrap()).unwrap();
    let snapped = snap(&mesh, map.lattice(), policy).unwrap();
    let oracle = Oracle::new(&snapped);
    let texels = (240..272).flat_map(|y| (576..608).map(move |x| [x, y]));
    let held = texels.map(|[x, y]| (oracle.accepts(x, y, map.texel(x, y, 0).unwrap().value), [x, y]));
    let (wrong, right): (Vec<_>, Vec<_>) = held.partition(|((accepted, _), _)| !accepted);
    assert_eq!(wrong, []);
    assert!(right.iter().filter(|((_, certified), _)| *certified).count() > 900);
}
