//! The same bits, whoever renders and however it is shared out.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::sync::Arc;

use coordinator::{PixelFormat, Pixels, Rendered};
use tessera_core::film::{Region, encode};
use tessera_core::settings::Transfer;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate;

fn demo() -> Cluster {
    Cluster::of(generate::demo().scene().unwrap()).size(161, 119)
}

/// What core renders without any farm.
fn directly(cluster: &Cluster) -> (Vec<[f32; 3]>, u64) {
    let prepared = Arc::new(PreparedScene::build(cluster.job.scene.scene().clone()));
    let (tile, rays) = Tracer::new(prepared, cluster.job.settings).unwrap().render(cluster.job.region);
    (tile.pixels, rays.camera)
}

fn floats(rendered: &Rendered) -> &[[f32; 3]] {
    let Some(Pixels::F32(pixels)) = rendered.image.pixels() else { panic!("not floats") };
    pixels
}

fn same_bits(a: &[[f32; 3]], b: &[[f32; 3]]) -> bool {
    a.as_flattened().iter().map(|x| x.to_bits()).eq(b.as_flattened().iter().map(|x| x.to_bits()))
}

#[test]
fn every_division_of_the_work_gives_the_picture_that_core_gives() {
    let (wanted, camera_rays) = directly(&demo());
    for workers in [1, 2, 5] {
        for tile in [8, 32, 64] {
            for threads in [1, 2] {
                let rendered = demo().workers(workers, threads).tile(tile).render().unwrap();
                let case = format!("{workers} workers of {threads} threads, tiles of {tile}");
                assert!(same_bits(floats(&rendered), &wanted), "{case}");
                assert!(rendered.is_complete(), "{case}");
                assert_eq!(rendered.rays.camera, camera_rays, "{case}");
                assert_eq!(rendered.tiles, u64::from(161u32.div_ceil(tile) * 119u32.div_ceil(tile)), "{case}");
            }
        }
    }
    let rendered = demo().render().unwrap();
    assert!(same_bits(floats(&rendered), &wanted), "tiles by cost");
}

#[test]
fn a_picture_too_large_for_memory_is_the_same() {
    for format in [PixelFormat::Rgb8, PixelFormat::F32] {
        let render = |in_memory| {
            let mut cluster = demo().tile(16);
            cluster.job.pixels = format;
            cluster.job.scratch.in_memory = in_memory;
            cluster.render().unwrap()
        };
        let (memory, disk) = (render(u64::MAX), render(0));
        assert!(memory.image.pixels().is_some() && disk.image.pixels().is_none() && disk.is_complete());
        assert_eq!(memory.image.sha256().unwrap(), disk.image.sha256().unwrap(), "{format:?}");
    }
}

#[test]
fn a_part_of_the_picture_is_that_part() {
    let mut part = demo();
    part.job.region = Region::new(13, 7, 90, 100).unwrap();
    let wanted = directly(&part).0;
    assert!(same_bits(floats(&part.tile(16).render().unwrap()), &wanted));
}

#[test]
fn integers_travel_where_integers_are_wanted_and_are_those_of_the_floats() {
    for (pixels, transfer) in [(PixelFormat::Rgb8, Transfer::Srgb), (PixelFormat::Rgb16, Transfer::Linear)] {
        let mut cluster = demo();
        (cluster.job.pixels, cluster.job.settings.transfer) = (pixels, transfer);
        let linear = directly(&cluster).0;
        let wanted = match pixels {
            PixelFormat::Rgb8 => Pixels::Rgb8(encode::to_bytes(transfer, &linear)),
            _ => Pixels::Rgb16(encode::to_words(transfer, &linear)),
        };
        assert_eq!(cluster.render().unwrap().image, wanted);
    }
}
