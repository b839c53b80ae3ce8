//! How long a scene takes into its binary form and back, and how large it is.
//!
//! `cargo run --release -p tessera-tests --example scene_transfer [TRIANGLES]`

use std::time::Instant;

use glam::{DVec3, dvec3};
use tessera_core::scene::{SceneBuilder, Surface};
use tessera_proto::limits::SCENE_PIECE_BYTES;
use tessera_proto::scene::{SceneDecoder, SceneEncoder, describe};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let triangles: u32 = std::env::args().nth(1).map_or(Ok(871_414), |n| n.parse())?;
    let mut builder = SceneBuilder::new();
    builder.camera(DVec3::Z, DVec3::Y, DVec3::ZERO)?;
    let surface = builder.surface(Surface::default())?;
    for i in 0..triangles {
        let at = dvec3(f64::from(i).sqrt(), f64::from(i % 97) / 3.0, 1.0);
        builder.triangle([at, at + DVec3::X, at + DVec3::Y], surface)?;
    }
    let scene = builder.finish()?;
    for _ in 0..3 {
        let start = Instant::now();
        let (_, length) = describe(&scene);
        let described = start.elapsed();
        let start = Instant::now();
        let pieces: Vec<_> = SceneEncoder::new(&scene, SCENE_PIECE_BYTES).collect();
        let encoded = start.elapsed();
        let start = Instant::now();
        let mut decoder = SceneDecoder::new(length)?;
        for piece in &pieces {
            decoder.push(piece)?;
        }
        let same = decoder.finish()? == scene;
        println!(
            "{length} bytes, {:.5} of the numbers' own; encoded {encoded:.1?}, and hashed {described:.1?}, decoded and compared {:.1?}, same: {same}",
            length as f64 / (72 * triangles) as f64,
            start.elapsed()
        );
    }
    Ok(())
}
