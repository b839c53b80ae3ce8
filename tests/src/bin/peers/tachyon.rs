//! Scenes in Tachyon's own language.
//!
//! Its camera sees the world left-handed, as the image model does. Colours only: where a
//! surface has a picture, it is white. It samples pixels at a corner rather than in the
//! middle: its picture of the same scene is half a pixel away.

use std::io::{self, Write};

use glam::DVec3;
use tessera_core::scene::{Pigment, PlanePosition, Scene, SurfaceId};
use tessera_core::settings::Settings;

/// Writes the scene; colours are taken as linear.
///
/// # Errors
/// What writing can meet.
pub(crate) fn write(scene: &Scene, settings: &Settings, out: &mut impl Write) -> io::Result<()> {
    let view = &settings.view;
    writeln!(out, "BEGIN_SCENE\nRESOLUTION {} {}", view.width(), view.height())?;
    let camera = scene.camera();
    writeln!(
        out,
        "CAMERA ZOOM {} ASPECTRATIO 1 ANTIALIASING 0 RAYDEPTH {} CENTER {} VIEWDIR {} UPDIR {} END_CAMERA",
        view.zoom() / view.plane_height(),
        settings.max_depth,
        vector(camera.location()),
        vector(camera.look_at() - camera.location()),
        vector(camera.sky()),
    )?;
    writeln!(out, "BACKGROUND {}", color(scene.background()))?;
    for &light in scene.lights() {
        writeln!(out, "LIGHT CENTER {} RAD 0.001 COLOR 1 1 1", vector(light))?;
    }
    for s in scene.spheres() {
        writeln!(out, "SPHERE CENTER {} RAD {} {}", vector(s.center), s.radius, texture(scene, s.surface))?;
    }
    for t in scene.triangles() {
        let [a, b, c] = t.corners().map(vector);
        writeln!(out, "TRI V0 {a} V1 {b} V2 {c} {}", texture(scene, t.surface()))?;
    }
    for p in scene.planes() {
        let n = p.normal.normalize();
        let point = match p.position {
            PlanePosition::Point(q) => q,
            PlanePosition::Distance(d) => n * d,
        };
        writeln!(out, "PLANE CENTER {} NORMAL {} {}", vector(point), vector(n), texture(scene, p.surface))?;
    }
    writeln!(out, "END_SCENE")
}

fn vector(v: DVec3) -> String {
    format!("{} {} {}", v.x, v.y, v.z)
}

fn color([r, g, b]: [f64; 3]) -> String {
    format!("{r} {g} {b}")
}

fn texture(scene: &Scene, id: SurfaceId) -> String {
    let surface = scene.surface(id);
    let pigment = match surface.pigment {
        Pigment::Color(c) => color(c),
        Pigment::Texture(_) => color([1.0; 3]),
    };
    format!(
        "TEXTURE AMBIENT 0 DIFFUSE {} SPECULAR {} OPACITY 1 COLOR {pigment} TEXFUNC 0",
        surface.diffuse, surface.reflect
    )
}
