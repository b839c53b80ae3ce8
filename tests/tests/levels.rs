//! Every instruction set gives the same bits and traces the same rays.

use std::path::Path;
use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_core::xml::{ReadOptions, read_file};

/// Bits of the picture and counts of rays of one of the scenes beside the tests.
fn render(scene: &str, how: impl FnOnce(Tracer) -> Tracer, samples: u64) -> (Vec<[u32; 3]>, [u64; 4]) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene);
    let read = read_file(&path, &ReadOptions::default()).expect("the scene is valid");
    let settings = Settings {
        view: View::new(101, 67, 1.0, 1.0).expect("a view"),
        // Longer than a wave keeps paths, where that is not too dear.
        max_depth: if samples == 1 { 80 } else { 6 },
        sampling: Sampling::uniform(samples).expect("a square"),
        transfer: Transfer::Srgb,
    };
    let prepared = Arc::new(PreparedScene::build(Arc::new(read.scene)));
    let tracer = how(Tracer::new(prepared, settings).expect("settings are in range"));
    let (tile, counts) = tracer.render(Region::new(0, 0, 101, 67).expect("not empty"));
    let bits = tile.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
    (bits, [counts.camera, counts.mirror, counts.shadow, counts.unresolved])
}

#[test]
fn all_levels_agree_bit_for_bit() {
    let levels = Level::all();
    assert_eq!(levels[0], Level::Baseline);
    println!("levels of this machine: {levels:?}");
    for scene in ["demo.xml", "mirrors.xml", "lights.xml", "sphereflake2.xml", "terrain8.xml", "knot.xml"] {
        for samples in [1, 4] {
            // By f64 alone, which packets of f32 only spare work.
            let plain = render(scene, Tracer::without_filter, samples);
            for &level in &levels {
                let wide = render(scene, |tracer| tracer.with_level(level), samples);
                let differ = plain.0.iter().zip(&wide.0).filter(|(a, b)| a != b).count();
                assert_eq!(differ, 0, "{scene} at {level:?}, {samples} samples: pixels differ");
                assert_eq!(plain.1, wide.1, "{scene} at {level:?}: other rays were traced");
            }
        }
    }
}
