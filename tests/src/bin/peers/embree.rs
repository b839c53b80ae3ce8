//! Scenes as an Embree program reads them: little-endian f32 and u32, nothing to parse.
//!
//! ```text
//! u32 spheres, triangles, planes, lights, materials, max depth
//! f32 location[3], sky[3], look_at[3], background[3]
//! materials  f32 diffuse, reflect, colour[3]
//! lights     f32 place[3]
//! spheres    f32 centre[3], radius         u32 material
//! triangles  f32 corners[3][3]             u32 material
//! planes     f32 unit normal[3], distance  u32 material
//! ```
//! The image plane is 1 high, 1 away. Where a surface has a picture, it is white.

use std::io::{self, Write};

use glam::DVec3;
use tessera_core::scene::{Pigment, PlanePosition, Scene, SurfaceId};
use tessera_core::settings::Settings;

/// Writes the scene; colours are taken as linear.
///
/// # Errors
/// What writing can meet.
pub(crate) fn write(scene: &Scene, settings: &Settings, out: &mut impl Write) -> io::Result<()> {
    let counts = [
        scene.spheres().len(),
        scene.triangles().len(),
        scene.planes().len(),
        scene.lights().len(),
        scene.surfaces().len(),
    ];
    for count in counts {
        whole(u32::try_from(count).map_err(io::Error::other)?, out)?;
    }
    whole(settings.max_depth, out)?;
    let camera = scene.camera();
    for v in [camera.location(), camera.sky(), camera.look_at()] {
        vector(v, out)?;
    }
    floats(&scene.background(), out)?;
    for surface in scene.surfaces() {
        let color = match surface.pigment {
            Pigment::Color(c) => c,
            Pigment::Texture(_) => [1.0; 3],
        };
        floats(&[surface.diffuse, surface.reflect], out)?;
        floats(&color, out)?;
    }
    for &light in scene.lights() {
        vector(light, out)?;
    }
    for s in scene.spheres() {
        vector(s.center, out)?;
        floats(&[s.radius], out)?;
        material(s.surface, out)?;
    }
    for t in scene.triangles() {
        for corner in t.corners() {
            vector(corner, out)?;
        }
        material(t.surface(), out)?;
    }
    for p in scene.planes() {
        let n = p.normal.normalize();
        let distance = match p.position {
            PlanePosition::Point(q) => q.dot(n),
            PlanePosition::Distance(d) => d,
        };
        vector(n, out)?;
        floats(&[distance], out)?;
        material(p.surface, out)?;
    }
    Ok(())
}

fn whole(n: u32, out: &mut impl Write) -> io::Result<()> {
    out.write_all(&n.to_le_bytes())
}

fn material(id: SurfaceId, out: &mut impl Write) -> io::Result<()> {
    whole(id.0, out)
}

fn floats(values: &[f64], out: &mut impl Write) -> io::Result<()> {
    values.iter().try_for_each(|x| out.write_all(&(*x as f32).to_le_bytes()))
}

fn vector(v: DVec3, out: &mut impl Write) -> io::Result<()> {
    floats(&v.to_array(), out)
}
