//! The format's declarations, as data.

/// One place in a sequence of children.
#[derive(Debug)]
pub(super) struct Slot {
    /// Names that may fill it; more than one: a choice.
    pub names: &'static [&'static str],
    pub required: bool,
}

/// An attribute.
#[derive(Debug)]
pub(super) struct Attribute {
    pub name: &'static str,
    pub required: bool,
}

/// What an element may hold.
#[derive(Debug)]
pub(super) struct Model {
    /// Children in order; none at all: the element is empty.
    pub slots: &'static [Slot],
    pub attributes: &'static [Attribute],
    /// The children in words.
    pub content: &'static str,
}

const fn one(name: &'static [&'static str]) -> Slot {
    Slot { names: name, required: true }
}
const fn maybe(name: &'static [&'static str]) -> Slot {
    Slot { names: name, required: false }
}
const fn must(name: &'static str) -> Attribute {
    Attribute { name, required: true }
}
const fn may(name: &'static str) -> Attribute {
    Attribute { name, required: false }
}

/// The attribute that names a file; all others hold a number.
pub(super) const FILE: &str = "file";

/// The most children in order, and the most attributes, that any model has.
pub(super) const WIDEST: usize = 4;

pub(super) static SCENE: Model = Model {
    slots: &[one(&["camera"]), maybe(&["background"]), one(&["world"])],
    attributes: &[],
    content: "camera, then background if any, then world",
};
pub(super) static CAMERA: Model = Model {
    slots: &[one(&["location"]), one(&["sky"]), one(&["look_at"])],
    attributes: &[],
    content: "location, then sky, then look_at",
};
/// Every element that holds one vector.
pub(super) static VECTOR_HOLDER: Model = Model { slots: &[one(&["vector"])], attributes: &[], content: "one vector" };
pub(super) static VECTOR: Model =
    Model { slots: &[], attributes: &[must("x"), must("y"), must("z")], content: "nothing, not even white space" };
pub(super) static BACKGROUND: Model = Model { slots: &[one(&["color"])], attributes: &[], content: "one color" };
pub(super) static COLOR: Model = Model {
    slots: &[],
    attributes: &[must("red"), must("green"), must("blue")],
    content: "nothing, not even white space",
};
pub(super) static LIGHT: Model = Model { slots: &[one(&["position"])], attributes: &[], content: "one position" };
pub(super) static SURFACE: Model = Model {
    slots: &[maybe(&["finish"]), maybe(&["pigment"])],
    attributes: &[],
    content: "finish if any, then pigment if any",
};
pub(super) static FINISH: Model =
    Model { slots: &[], attributes: &[may("diffuse"), may("reflect")], content: "nothing, not even white space" };
pub(super) static PIGMENT: Model =
    Model { slots: &[one(&["color", "image"])], attributes: &[], content: "one color or one image" };
pub(super) static IMAGE: Model = Model { slots: &[one(&["ppm"])], attributes: &[], content: "one ppm" };
pub(super) static PPM: Model =
    Model { slots: &[], attributes: &[must(FILE)], content: "nothing, not even white space" };
pub(super) static TRIANGLE_BY_CORNERS: Model = Model {
    slots: &[one(&["c0"]), one(&["c1"]), one(&["c2"]), maybe(&["surface"])],
    attributes: &[],
    content: "c0, then c1 and c2, or v1 and v2, then surface if any",
};
pub(super) static TRIANGLE_BY_SIDES: Model = Model {
    slots: &[one(&["c0"]), one(&["v1"]), one(&["v2"]), maybe(&["surface"])],
    attributes: &[],
    content: "c0, then c1 and c2, or v1 and v2, then surface if any",
};
pub(super) static PLANE: Model = Model {
    slots: &[one(&["normal"]), maybe(&["point"]), maybe(&["surface"])],
    attributes: &[may("distance")],
    content: "normal, then point if any, then surface if any",
};
pub(super) static SPHERE: Model = Model {
    slots: &[one(&["location"]), maybe(&["pole"]), maybe(&["equator"]), maybe(&["surface"])],
    attributes: &[must("radius")],
    content: "location, then pole, equator and surface, each if any",
};

/// What a world holds, in any number and order.
pub(super) const OBJECTS: [&str; 4] = ["plane", "light", "sphere", "triangle"];

/// Every element of the format.
pub(super) const ELEMENTS: [&str; 28] = [
    "scene",
    "camera",
    "location",
    "sky",
    "look_at",
    "position",
    "normal",
    "point",
    "pole",
    "equator",
    "c0",
    "c1",
    "c2",
    "v1",
    "v2",
    "vector",
    "background",
    "color",
    "world",
    "light",
    "surface",
    "finish",
    "pigment",
    "image",
    "ppm",
    "triangle",
    "plane",
    "sphere",
];
