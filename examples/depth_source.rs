//! An engine that renders depth itself: a ball that floats over a floor, seen straight from above.
//!
//!     cargo run --example depth_source

use std::sync::Arc;

use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::layers::{
    DepthScale, DepthSource, LayersOptions, Projection, Second, SourceError, Square, bake_layers,
};

/// Half the side of the map, world units.
const HALF: f64 = 2.0;
const RESOLUTION: u64 = 512;

struct Engine;

impl DepthSource for Engine {
    fn name(&self) -> &str {
        "sun"
    }

    fn projection(&self) -> Projection {
        // The light comes down along -y from y = 10; texels run along x and z.
        let texels = RESOLUTION as f64 / (2.0 * HALF);
        let middle = RESOLUTION as f64 / 2.0;
        Projection {
            world_to_layers: [[texels, 0.0, 0.0, middle], [0.0, 0.0, texels, middle], [0.0, -1.0, 0.0, 10.0]],
            log2_resolution: RESOLUTION.ilog2() as u8,
            depth: DepthScale::Between(0.0, 20.0),
        }
    }

    fn second(&self) -> Second {
        Second::Exit
    }

    fn key(&self) -> Vec<u8> {
        b"ball over floor, version 1".to_vec()
    }

    fn render(&self, square: Square, first: &mut [f64], second: &mut [f64]) -> Result<(), SourceError> {
        for i in 0..square.texels() {
            let [x, z] = square.texel(i).map(|t| (f64::from(t) + 0.5) / RESOLUTION as f64 * 2.0 * HALF - HALF);
            let under = 1.0 - x * x - z * z;
            // The ball of radius 1 around y = 3; the floor at y = 0 is never left.
            (first[i], second[i]) =
                if under > 0.0 { (7.0 - under.sqrt(), 7.0 + under.sqrt()) } else { (10.0, f64::INFINITY) };
        }
        Ok(())
    }
}

/// Bakes, then looks a few points up.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::temp_dir().join(format!("umbrage-depth-source-{}.umb", std::process::id()));
    let baked = bake_layers(&[&Engine], &LayersOptions::default(), &path, &Default::default())?;
    println!("{} bytes, {} nodes", baked.bytes, baked.lights[0].nodes.iter().sum::<u64>());
    let container = Container::open(Arc::new(FileSource::open(&path)?), Limits::default())?;
    let map = Map::new(container.structure_named("sun")?)?;
    // A centre of a texel near the middle: above the ball, in its shadow, on the floor beside it.
    let c = 0.5 / RESOLUTION as f64 * 2.0 * HALF;
    for (point, lit) in [([c, 4.5, c], true), ([c, 0.0, c], false), ([1.5 + c, 0.0, c], true)] {
        assert_eq!(map.visibility(point, 0)?.lit, lit, "{point:?}");
    }
    drop((map, container));
    std::fs::remove_file(&path)?;
    Ok(())
}
