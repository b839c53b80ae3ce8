//! The extremes suite: nothing but the scene and the pixel decides.

use std::sync::Arc;

use glam::dvec3;
use sha2::{Digest, Sha256};
use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::generate::extreme::basic;
use tessera_tests::generate::{self, Document, Item, Random};
use tessera_tests::subject::{Subject, settings};

fn hash(pixels: &[[f32; 3]]) -> Vec<u8> {
    let mut hasher = Sha256::new();
    pixels.iter().flatten().for_each(|c| hasher.update(c.to_le_bytes()));
    hasher.finalize().to_vec()
}

/// The picture put together from tiles of the given edge, by as many threads as asked for.
fn tiled(document: &Document, settings: Settings, edge: u32, threads: usize) -> Vec<u8> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be had");
    let (w, h) = (settings.view.width(), settings.view.height());
    let mut whole = vec![[0f32; 3]; (w * h) as usize];
    pool.install(|| {
        let prepared = Arc::new(PreparedScene::build(Arc::new(document.scene().expect("the scene is valid"))));
        let tracer = Tracer::new(prepared, settings).expect("the settings are valid");
        for y in (0..h).step_by(edge as usize) {
            for x in (0..w).step_by(edge as usize) {
                let region = Region::new(x, y, (x + edge).min(w), (y + edge).min(h)).expect("not empty");
                let tile = tracer.render(region).0;
                for (k, pixel) in tile.pixels.iter().enumerate() {
                    let (dx, dy) = (k as u32 % region.width(), k as u32 / region.width());
                    whole[((y + dy) * w + x + dx) as usize] = *pixel;
                }
            }
        }
    });
    hash(&whole)
}

#[test]
fn case_68_tiles_and_threads_do_not_show() {
    let sampled = Settings { sampling: Sampling::Uniform { grid: 2 }, ..settings(80, 60) };
    for document in [basic(), generate::demo(), generate::sphereflake(2), generate::terrain(16), generate::mirrors()] {
        let once = tiled(&document, sampled, 80, 1);
        for (edge, threads) in [(1, 2), (7, 1), (16, 2), (33, 5), (80, 2)] {
            assert!(tiled(&document, sampled, edge, threads) == once, "tiles of {edge}, {threads} threads");
        }
    }
}

#[test]
fn case_69_order_of_objects_does_not_show() {
    let mut random = Random::new(69);
    for document in [basic(), generate::demo(), generate::sphereflake(2), generate::knot_scene(24, 8)] {
        let once = Subject::new(&document).pixels(&settings(80, 60));
        for _ in 0..4 {
            let mut shuffled = document.clone();
            // Lights keep their order: it is the order of a sum.
            let (lights, mut objects): (Vec<Item>, Vec<Item>) =
                document.items.iter().partition(|i| matches!(i, Item::Light(_)));
            for k in (1..objects.len()).rev() {
                objects.swap(k, random.below(k as u64 + 1) as usize);
            }
            shuffled.items = lights.into_iter().chain(objects).collect();
            assert!(Subject::new(&shuffled).pixels(&settings(80, 60)) == once);
        }
    }
}

#[test]
fn a_tree_and_no_tree_see_the_same() {
    // Objects out of sight change the hierarchy, not the picture.
    let once = Subject::new(&basic()).pixels(&settings(80, 60));
    let mut random = Random::new(70);
    for count in [1, 7, 60, 500] {
        let mut crowded = basic();
        for _ in 0..count {
            // Far behind the camera, below the floor, and beyond no light.
            let at = dvec3(random.between(-9.0, 9.0), random.between(-9.0, -5.0), random.between(-30.0, -20.0));
            let look = generate::Look::matte(1.0, 0.0, 1.0);
            crowded = crowded.sphere(at, 0.3, look).triangle([at, at + random.cube(), at + random.cube()], look);
        }
        assert!(Subject::new(&crowded).pixels(&settings(80, 60)) == once, "{count}");
    }
}
