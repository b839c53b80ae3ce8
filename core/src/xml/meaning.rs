//! What elements mean: the camera, lights, surfaces and objects.
//!
//! Written once, for elements wherever they come from: a tree, whose every problem is told, or the bytes of the
//! text, where whatever is not ordinary is refused and left to a tree.

use glam::DVec3;

use super::diagnostic::Code;
use super::finding::Finding;
use super::grammar::{self, Model};
use super::part::{Finish, Object, Paint, Plane, Sphere, Triangle};
use super::source::shown;
use crate::numeric::zero_area::{is_zero, surely_not_zero};
use crate::scene::{Camera, Invalid, PlanePosition, rules};

/// A source of elements, each fitted to its model in the grammar.
///
/// The text is read as it comes: of an open element, attributes are asked for in the model's order, then every
/// child, each opened and closed before the next, then the element is closed.
pub(super) trait Elements {
    /// An element that was not looked into yet.
    type Element: Copy;
    /// One that was.
    type Open: Clone;
    type Attribute: Copy;
    /// Whether exact arithmetic decides what is in doubt. Else it is told of, which refuses it.
    const EXACT: bool;

    fn open(&mut self, element: Self::Element, model: &'static Model) -> Self::Open;
    /// Opens an element that has one of two forms.
    fn open_either(&mut self, element: Self::Element, first: &'static Model, second: &'static Model) -> Self::Open;
    /// The open element in its second form if it has that, as the child at `place` tells, which is the next one.
    fn second_form(&mut self, open: &Self::Open, second: &'static Model, place: usize) -> Option<Self::Open>;
    /// The attribute at a place of the model.
    fn attribute(&mut self, open: &Self::Open, place: usize) -> Option<Self::Attribute>;
    /// The child at a place of the model.
    fn child(&mut self, open: &Self::Open, place: usize) -> Option<Self::Element>;
    fn close(&mut self, _: &Self::Open) {}
    /// The grammar's name for an element.
    fn name(element: &Self::Element) -> &str;
    /// An attribute as a number.
    fn number(&mut self, attribute: Self::Attribute) -> Option<f64>;
    /// The number of the file that an attribute names.
    fn file(&mut self, attribute: Self::Attribute) -> Option<u32>;
    /// The number of the [`surface`] in an element; of the default one where there is none.
    fn surface(&mut self, element: Option<Self::Element>) -> Option<u32>;
    /// Tells of a problem. `finding` is also given an attribute's name and what is written there.
    fn find(&mut self, code: Code, at: Spot<'_, Self>, finding: impl FnOnce(Finding, &str, &str) -> Finding);
}

/// What a finding points to.
pub(super) enum Spot<'o, E: Elements + ?Sized> {
    /// An element's name.
    Tag(&'o E::Open),
    Attribute(E::Attribute),
    Value(E::Attribute),
}

pub(super) fn camera<E: Elements>(from: &mut E, element: E::Element) -> Option<Camera> {
    let camera = from.open(element, &grammar::CAMERA);
    let location = child_vector(from, &camera, 0);
    let sky = from.child(&camera, 1).and_then(|s| direction(from, s));
    let look_at = child_vector(from, &camera, 2);
    from.close(&camera);
    let ((location, _), (look_at, look_at_tag)) = (location?, look_at?);
    // Of a sky that is missing or zero, enough is said.
    let up = sky.as_ref().map_or(DVec3::ZERO, |(sky, _)| *sky);
    match (rules::view(location, up, look_at), &sky) {
        (Err(Invalid::NoView), _) => from.find(Code::CameraView, Spot::Tag(&look_at_tag), |f, _, _| {
            f.say("`look_at` equals `location`").expected("a point other than the camera's own place")
        }),
        (Err(Invalid::SkyParallel), Some((_, tag))) => from.find(Code::CameraSky, Spot::Tag(tag), |f, _, _| {
            f.say("`sky` is parallel to the view direction").expected("a `sky` that points away from the line of sight")
        }),
        _ => return sky.map(|(sky, _)| Camera { location, sky, look_at }),
    }
    None
}

pub(super) fn background<E: Elements>(from: &mut E, element: E::Element) -> Option<[f64; 3]> {
    let background = from.open(element, &grammar::BACKGROUND);
    let color = from.child(&background, 0).and_then(|c| color(from, c));
    from.close(&background);
    color
}

/// A child of the world.
#[inline(always)]
pub(super) fn object<E: Elements>(from: &mut E, element: E::Element) -> Option<Object> {
    match E::name(&element) {
        "triangle" => triangle(from, element),
        "sphere" => sphere(from, element),
        "plane" => plane(from, element),
        "light" => light(from, element),
        _ => None,
    }
}

fn light<E: Elements>(from: &mut E, element: E::Element) -> Option<Object> {
    let light = from.open(element, &grammar::LIGHT);
    let position = child_vector(from, &light, 0);
    from.close(&light);
    Some(Object::Light(position?.0))
}

#[inline(always)]
fn triangle<E: Elements>(from: &mut E, element: E::Element) -> Option<Object> {
    let triangle = from.open_either(element, &grammar::TRIANGLE_BY_CORNERS, &grammar::TRIANGLE_BY_SIDES);
    let a = child_vector(from, &triangle, 0);
    let sides = from.second_form(&triangle, &grammar::TRIANGLE_BY_SIDES, 1);
    let by_sides = sides.is_some();
    let (b, c) = match &sides {
        Some(sides) => (child_vector(from, sides, 1), child_vector(from, sides, 2)),
        None => (child_vector(from, &triangle, 1), child_vector(from, &triangle, 2)),
    };
    let surface = from.child(&triangle, 3);
    let surface = from.surface(surface);
    from.close(&triangle);
    let written = [a?.0, b?.0, c?.0];
    if !surely_not_zero(&written, by_sides) && (!E::EXACT || is_zero(&written, by_sides)) {
        from.find(Code::DegenerateTriangle, Spot::Tag(&triangle), |f, _, _| {
            f.say("this triangle has no area and is never hit").expected("three corners that are not on one line")
        });
    }
    Some(Object::Triangle(Triangle { written, surface: surface?, by_sides }))
}

fn plane<E: Elements>(from: &mut E, element: E::Element) -> Option<Object> {
    let plane = from.open(element, &grammar::PLANE);
    let distance = from.attribute(&plane, 0);
    let normal = from.child(&plane, 0).and_then(|n| direction(from, n));
    let point = from.child(&plane, 1);
    if let (Some(_), Some(distance)) = (&point, distance) {
        from.find(Code::PlanePosition, Spot::Attribute(distance), |f, _, _| {
            f.say("this plane has both a `point` and a `distance`")
                .expected("one of them, or neither for a plane through the origin")
        });
    }
    let distance = distance.map_or(Some(0.0), |d| from.number(d));
    let position = match point {
        Some(point) => vector(from, point).map(|(p, _)| PlanePosition::Point(p)),
        None => distance.map(PlanePosition::Distance),
    };
    let surface = from.child(&plane, 2);
    let surface = from.surface(surface);
    from.close(&plane);
    Some(Object::Plane(Plane { normal: normal?.0, position: position?, surface: surface? }))
}

fn sphere<E: Elements>(from: &mut E, element: E::Element) -> Option<Object> {
    let sphere = from.open(element, &grammar::SPHERE);
    let radius = from.attribute(&sphere, 0).and_then(|r| radius(from, r));
    let center = child_vector(from, &sphere, 0);
    let pole = from.child(&sphere, 1).map(|p| direction(from, p));
    let equator = from.child(&sphere, 2).map(|e| direction(from, e));
    // One that is wrong is as good as absent, until all is read.
    let [pole_vector, equator_vector] = [&pole, &equator].map(|d| d.as_ref()?.as_ref().map(|(v, _)| *v));
    let orientation = rules::orientation(pole_vector, equator_vector);
    if let (Err(_), Some(Some((_, tag)))) = (&orientation, &equator) {
        from.find(Code::Orientation, Spot::Tag(tag), |f, _, _| {
            f.say("`pole` and `equator` are parallel").expected("an `equator` in another direction than `pole`")
        });
    }
    let surface = from.child(&sphere, 3);
    let surface = from.surface(surface);
    from.close(&sphere);
    let wrong = matches!(pole, Some(None)) || matches!(equator, Some(None));
    let orientation = orientation.ok().filter(|_| !wrong);
    Some(Object::Sphere(Sphere { center: center?.0, radius: radius?, orientation: orientation?, surface: surface? }))
}

fn radius<E: Elements>(from: &mut E, attribute: E::Attribute) -> Option<f64> {
    let radius = rules::radius(from.number(attribute)?);
    if radius.is_err() {
        from.find(Code::Radius, Spot::Value(attribute), |f, _, written| {
            f.say(format!("radius {} is not above 0", shown(written.trim()))).expected("a number above 0")
        });
    }
    radius.ok()
}

// -- surfaces ------------------------------------------------------------------

pub(super) fn surface<E: Elements>(from: &mut E, element: E::Element) -> Option<Finish> {
    let surface = from.open(element, &grammar::SURFACE);
    let default = Finish::default();
    let finish = from.child(&surface, 0);
    let shares = finish.map_or(Some((default.diffuse, default.reflect)), |f| finish_shares(from, f));
    let pigment = from.child(&surface, 1);
    let paint = pigment.map_or(Some(default.paint), |p| pigment_paint(from, p));
    from.close(&surface);
    let ((diffuse, reflect), paint) = (shares?, paint?);
    Some(Finish { diffuse, reflect, paint })
}

/// The shares that are scattered and mirrored.
fn finish_shares<E: Elements>(from: &mut E, element: E::Element) -> Option<(f64, f64)> {
    let finish = from.open(element, &grammar::FINISH);
    let diffuse = from.attribute(&finish, 0);
    let reflect = from.attribute(&finish, 1);
    if diffuse.is_none() && reflect.is_none() {
        from.find(Code::BlackFinish, Spot::Tag(&finish), |f, _, _| {
            f.say("a `finish` with neither diffuse nor reflect makes a black surface")
                .expected("diffuse=\"…\", reflect=\"…\" or both; without the element: diffuse 1")
        });
    }
    let diffuse = diffuse.map_or(Some(0.0), |d| share(from, d));
    let reflect = reflect.map_or(Some(0.0), |r| share(from, r));
    from.close(&finish);
    let (diffuse, reflect) = (diffuse?, reflect?);
    if diffuse + reflect > 1.0 {
        from.find(Code::BrightFinish, Spot::Tag(&finish), |f, _, _| {
            f.say(format!(
                "diffuse + reflect is {}: the surface sends out more light than it takes in",
                diffuse + reflect
            ))
            .expected("a sum of at most 1")
        });
    }
    Some((diffuse, reflect))
}

fn pigment_paint<E: Elements>(from: &mut E, element: E::Element) -> Option<Paint> {
    let pigment = from.open(element, &grammar::PIGMENT);
    let child = from.child(&pigment, 0)?;
    let paint = match E::name(&child) {
        "color" => color(from, child).map(Paint::Color),
        _ => image(from, child).map(Paint::File),
    };
    from.close(&pigment);
    paint
}

fn color<E: Elements>(from: &mut E, element: E::Element) -> Option<[f64; 3]> {
    let color = from.open(element, &grammar::COLOR);
    let red = from.attribute(&color, 0).and_then(|a| share(from, a));
    let green = from.attribute(&color, 1).and_then(|a| share(from, a));
    let blue = from.attribute(&color, 2).and_then(|a| share(from, a));
    from.close(&color);
    Some([red?, green?, blue?])
}

fn image<E: Elements>(from: &mut E, element: E::Element) -> Option<u32> {
    let image = from.open(element, &grammar::IMAGE);
    let ppm = from.child(&image, 0)?;
    let ppm = from.open(ppm, &grammar::PPM);
    let file = from.attribute(&ppm, 0).and_then(|a| from.file(a));
    from.close(&ppm);
    from.close(&image);
    file
}

// -- values --------------------------------------------------------------------

/// A number in [0, 1].
fn share<E: Elements>(from: &mut E, attribute: E::Attribute) -> Option<f64> {
    let share = rules::share(from.number(attribute)?);
    if share.is_err() {
        from.find(Code::Range, Spot::Value(attribute), |f, name, written| {
            f.say(format!("`{name}` is {}, outside [0, 1]", shown(written.trim()))).expected("a number from 0 to 1")
        });
    }
    share.ok()
}

/// The vector in an element that holds one, and the vector's element.
#[inline(always)]
fn vector<E: Elements>(from: &mut E, holder: E::Element) -> Option<(DVec3, E::Open)> {
    let holder = from.open(holder, &grammar::VECTOR_HOLDER);
    let vector = from.child(&holder, 0)?;
    let vector = from.open(vector, &grammar::VECTOR);
    let x = from.attribute(&vector, 0).and_then(|a| from.number(a));
    let y = from.attribute(&vector, 1).and_then(|a| from.number(a));
    let z = from.attribute(&vector, 2).and_then(|a| from.number(a));
    from.close(&vector);
    from.close(&holder);
    Some((DVec3::new(x?, y?, z?), vector))
}

/// The vector in a child.
#[inline(always)]
fn child_vector<E: Elements>(from: &mut E, open: &E::Open, place: usize) -> Option<(DVec3, E::Open)> {
    from.child(open, place).and_then(|holder| vector(from, holder))
}

/// A vector that needs a direction.
fn direction<E: Elements>(from: &mut E, holder: E::Element) -> Option<(DVec3, E::Open)> {
    let (vector, tag) = vector(from, holder)?;
    // A zero of any kind: the finding says of which.
    if rules::direction(vector, Invalid::ZeroNormal).is_ok() {
        return Some((vector, tag));
    }
    from.find(Code::ZeroVector, Spot::Tag(&tag), |f, _, _| {
        f.say(format!("`{}` is zero and has no direction", E::name(&holder)))
            .expected("a vector that is not zero, of any length")
    });
    None
}
