//! A parsed tree against the declarations and the semantic checks.
//!
//! Every problem becomes a finding and reading goes on: a misspelt name is taken as
//! the one it resembles, an absent value as none, so that one mistake hides no other.

use std::ops::Range;

use roxmltree::Node;

use super::diagnostic::Code;
use super::finding::Finding;
use super::grammar::{self, Model, WIDEST};
use super::meaning::{self, Elements, Spot};
use super::number::{self, NotANumber};
use super::part::{Finish, Part};
use super::source::shown;
use super::suggest::closest;
use crate::scene::Camera;

/// From offsets in what the parser was given to offsets in the document: what lies
/// before `cut` is shifted by one amount, what lies behind by another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shift {
    pub cut: usize,
    pub before: isize,
    pub behind: isize,
}

impl Shift {
    pub(super) fn at(&self, offset: usize) -> usize {
        let by = if offset < self.cut { self.before } else { self.behind };
        offset.saturating_add_signed(by)
    }
}

/// What stands around the world.
#[derive(Debug, Default)]
pub(super) struct Frame {
    pub camera: Option<Camera>,
    pub background: Option<[f64; 3]>,
    /// The world's start tag's name.
    pub world: Option<Range<usize>>,
}

/// An element and the grammar's name for it, which the written one may only resemble.
type Element<'t> = (Node<'t, 't>, &'t str);
/// An attribute and the grammar's name for it.
type Attribute<'t> = (roxmltree::Attribute<'t, 't>, &'static str);

/// Children and attributes of an element, by the places its model gives them.
#[derive(Clone)]
pub(super) struct Fitted<'t> {
    node: Node<'t, 't>,
    model: &'static Model,
    children: [Option<Element<'t>>; WIDEST],
    attributes: [Option<Attribute<'t>>; WIDEST],
}

/// Checks trees and collects what they hold.
pub(super) struct Checker<'p, 't> {
    /// What the parser was given.
    pub source: &'t str,
    pub shift: Shift,
    pub part: &'p mut Part,
}

impl<'t> Checker<'_, 't> {
    fn range(&self, range: &Range<usize>) -> Range<usize> {
        let start = self.shift.at(range.start);
        start..start + range.len()
    }

    /// An element's name in its start tag.
    fn tag(&self, node: Node<'_, '_>) -> Range<usize> {
        let start = node.range().start + 1;
        self.range(&(start..start + node.tag_name().name().len()))
    }

    fn tell(&mut self, code: Code, at: Range<usize>, finding: impl FnOnce(Finding) -> Finding) {
        self.part.findings.push_with(code.severity(), || finding(Finding::new(code, at, "")));
    }

    // -- structure ---------------------------------------------------------------

    /// The document's root and all below it.
    pub(super) fn scene(&mut self, root: Node<'t, 't>) -> Frame {
        let name = root.tag_name().name();
        if name != "scene" {
            let code = if grammar::ELEMENTS.contains(&name) { Code::MisplacedElement } else { Code::UnknownElement };
            self.tell(code, self.tag(root), |f| {
                f.say(format!("the root element is `{}`", shown(name)))
                    .expected("scene")
                    .suggest(closest(name, ["scene"]))
            });
        }
        let scene = self.open((root, "scene"), &grammar::SCENE);
        let [camera, background, world, _] = scene.children;
        Frame {
            camera: camera.and_then(|e| meaning::camera(self, e)),
            background: background.and_then(|e| meaning::background(self, e)),
            world: world.map(|(n, _)| {
                self.world(n);
                self.tag(n)
            }),
        }
    }

    /// A world's children, each a light or an object.
    pub(super) fn world(&mut self, world: Node<'t, 't>) {
        self.attributes(world, "world", &[]);
        for child in world.children() {
            if !child.is_element() {
                self.no_text(child, "world", "plane, light, sphere and triangle elements");
                continue;
            }
            let name = child.tag_name().name();
            let meant = if grammar::OBJECTS.contains(&name) {
                Some(name)
            } else {
                let known = grammar::ELEMENTS.contains(&name);
                let near = if known { None } else { closest(name, grammar::OBJECTS) };
                self.tell(misplaced(known), self.tag(child), |f| {
                    f.say(wrong_child(known, name, "world")).expected("plane, light, sphere or triangle").suggest(near)
                });
                near
            };
            if let Some(object) = meant.and_then(|name| meaning::object(self, (child, name))) {
                self.part.push(object);
            }
        }
    }

    /// Whether a node between elements is text that may not be there.
    fn no_text(&mut self, node: Node<'_, '_>, parent: &str, content: &str) {
        let Some(text) = node.text().filter(|_| node.is_text()) else { return };
        self.part.blank = true;
        let Some(first) = text.find(|c| !matches!(c, ' ' | '\t' | '\r' | '\n')) else { return };
        let range = node.range();
        let written = &self.source[range.clone()];
        // Where the text has references or sections, offsets in it are not those of the source.
        let start = if written.get(first..).is_some_and(|w| text.get(first..).is_some_and(|t| w.starts_with(t))) {
            range.start + first
        } else {
            range.start + written.find(|c: char| !c.is_ascii_whitespace()).unwrap_or(0)
        };
        let end = start + self.source[start..range.end].trim_end().len().min(40);
        let at = self.range(&(start..end.max(start + 1)));
        self.tell(Code::UnexpectedContent, at, |f| {
            f.say(format!("`{parent}` may not hold text: `{}`", shown(text.trim()))).expected(content)
        });
    }

    fn attributes(
        &mut self,
        node: Node<'t, 't>,
        element: &str,
        known: &'static [grammar::Attribute],
    ) -> [Option<Attribute<'t>>; WIDEST] {
        let mut found = [None; WIDEST];
        let mut strangers = Vec::new();
        for attribute in node.attributes() {
            match known.iter().position(|k| k.name == attribute.name() && attribute.namespace().is_none()) {
                Some(i) => found[i] = Some((attribute, known[i].name)),
                None => strangers.push(attribute),
            }
        }
        for attribute in strangers {
            let free = known.iter().enumerate().filter(|(i, _)| found[*i].is_none()).map(|(_, k)| k.name);
            let near = closest(attribute.name(), free);
            let at = self.range(&attribute.range_qname());
            self.tell(Code::UnknownAttribute, at, |f| {
                let names: Vec<_> = known.iter().map(|k| k.name).collect();
                let names = if names.is_empty() { "no attributes".into() } else { names.join(", ") };
                f.say(format!("`{element}` has no attribute `{}`", shown(attribute.name())))
                    .expected(names)
                    .suggest(near)
            });
            if let Some(i) = known.iter().position(|k| Some(k.name) == near) {
                found[i] = Some((attribute, known[i].name));
            }
        }
        for (i, attribute) in known.iter().enumerate().filter(|(_, k)| k.required) {
            if found[i].is_none() {
                self.tell(Code::MissingAttribute, self.tag(node), |f| {
                    f.say(format!("`{element}` has no `{}`", attribute.name))
                        .expected(format!("{}=\"…\"", attribute.name))
                });
            }
        }
        found
    }

    fn value_range(&self, attribute: &roxmltree::Attribute<'_, '_>) -> Range<usize> {
        // The parser's own range of the value is wrong behind very long names or white space.
        let range = attribute.range();
        let written = &self.source[range.clone()];
        let quote = written.find(['"', '\'']).map_or(0, |i| i + 1);
        let start = range.start + quote;
        self.range(&(start..(range.end - 1).max(start)))
    }
}

impl<'t> Elements for Checker<'_, 't> {
    const EXACT: bool = true;
    type Element = Element<'t>;
    type Open = Fitted<'t>;
    type Attribute = Attribute<'t>;

    fn open(&mut self, (node, element): Element<'t>, model: &'static Model) -> Fitted<'t> {
        let attributes = self.attributes(node, element, model.attributes);
        let mut children: [Option<Element<'t>>; WIDEST] = [None; WIDEST];
        if model.slots.is_empty() {
            if let Some(child) = node.first_child() {
                let range = child.range();
                let at = self.range(&(range.start..range.start + range.len().min(1)));
                self.tell(Code::UnexpectedContent, at, |f| {
                    f.say(format!("`{element}` must be empty")).expected(format!("<{element} …/>"))
                });
            }
            return Fitted { node, model, children, attributes };
        }
        // The last place filled, which a later child may not stand before.
        let mut last: Option<usize> = None;
        for child in node.children() {
            if !child.is_element() {
                self.no_text(child, element, model.content);
                continue;
            }
            let name = child.tag_name().name();
            let tag = self.tag(child);
            let Some(place) = model.slots.iter().position(|s| s.names.contains(&name)) else {
                let known = grammar::ELEMENTS.contains(&name);
                let free = model.slots.iter().enumerate().filter(|(i, _)| children[*i].is_none());
                let near = if known { None } else { closest(name, free.flat_map(|(_, s)| s.names.iter().copied())) };
                self.tell(misplaced(known), tag, |f| {
                    f.say(wrong_child(known, name, element)).expected(model.content).suggest(near)
                });
                if let Some(place) = model.slots.iter().position(|s| near.is_some_and(|n| s.names.contains(&n))) {
                    children[place] = near.map(|near| (child, near));
                    last = last.max(Some(place));
                }
                continue;
            };
            if let Some((other, _)) = children[place] {
                let other = other.tag_name().name();
                self.tell(Code::MisplacedElement, tag, |f| {
                    let message = if other == name {
                        format!("a second `{name}` in `{element}`")
                    } else {
                        format!("`{name}` beside `{other}` in `{element}`")
                    };
                    f.say(message).expected(model.content)
                });
                continue;
            }
            if last.is_some_and(|l| l > place) {
                self.tell(Code::MisplacedElement, tag, |f| {
                    f.say(format!("`{name}` stands too late in `{element}`")).expected(model.content)
                });
            }
            last = last.max(Some(place));
            children[place] = Some((child, name));
        }
        for (place, slot) in model.slots.iter().enumerate() {
            if slot.required && children[place].is_none() {
                self.tell(Code::MissingElement, self.tag(node), |f| {
                    f.say(format!("`{element}` has no `{}`", slot.names.join("` or `"))).expected(model.content)
                });
            }
        }
        Fitted { node, model, children, attributes }
    }

    fn open_either(&mut self, element: Element<'t>, first: &'static Model, second: &'static Model) -> Fitted<'t> {
        let has = |model: &Model, name: &str| model.slots.iter().any(|s| s.names.contains(&name));
        // The first child that only one of them has tells.
        let names = element.0.children().filter(Node::is_element).map(|n| n.tag_name().name());
        let tells = names.map(|n| (has(first, n), has(second, n))).find(|(first, second)| first != second);
        self.open(element, if tells.is_some_and(|(_, second)| second) { second } else { first })
    }

    fn second_form(&mut self, open: &Fitted<'t>, second: &'static Model, _: usize) -> Option<Fitted<'t>> {
        std::ptr::eq(open.model, second).then(|| open.clone())
    }

    fn attribute(&mut self, open: &Fitted<'t>, place: usize) -> Option<Attribute<'t>> {
        open.attributes[place]
    }

    fn child(&mut self, open: &Fitted<'t>, place: usize) -> Option<Element<'t>> {
        open.children[place]
    }

    fn name<'e>(element: &'e Element<'t>) -> &'e str {
        element.1
    }

    fn number(&mut self, (attribute, name): Attribute<'t>) -> Option<f64> {
        let text = attribute.value();
        match number::parse(text) {
            Ok((value, underflow)) => {
                if underflow {
                    let at = self.value_range(&attribute);
                    self.tell(Code::Underflow, at, |f| {
                        f.say(format!("`{}` is too small and becomes 0", shown(text)))
                            .expected("a magnitude of at least 5e-324, or 0")
                    });
                }
                Some(value)
            }
            Err(why) => {
                let at = self.value_range(&attribute);
                let code = if why == NotANumber::Overflow { Code::Overflow } else { Code::Number };
                self.tell(code, at, |f| {
                    let (message, suggestion) = match why {
                        NotANumber::Empty => (format!("`{name}` is empty"), None),
                        NotANumber::NotFinite => (format!("`{}` is not a finite number", shown(text)), None),
                        NotANumber::Malformed(meant) => (format!("`{}` is not a number", shown(text)), meant),
                        NotANumber::Overflow => (format!("`{}` is too large a number", shown(text)), None),
                    };
                    let expected = if code == Code::Overflow {
                        "a magnitude of at most 1.7976931348623157e308"
                    } else {
                        "a decimal number such as -0.5, .5 or 1e-3"
                    };
                    f.say(message).expected(expected).suggest(suggestion)
                });
                None
            }
        }
    }

    fn file(&mut self, (attribute, name): Attribute<'t>) -> Option<u32> {
        let at = self.value_range(&attribute);
        if attribute.value().is_empty() {
            self.tell(Code::Texture, at, |f| {
                f.say(format!("`{name}` is empty")).expected("the name of a portable pixmap (.ppm)")
            });
            return None;
        }
        Some(self.part.file(attribute.value(), at))
    }

    fn surface(&mut self, element: Option<Element<'t>>) -> Option<u32> {
        let finish = element.map_or(Some(Finish::default()), |e| meaning::surface(self, e))?;
        Some(self.part.surface(finish))
    }

    fn find(&mut self, code: Code, at: Spot<'_, Self>, finding: impl FnOnce(Finding, &str, &str) -> Finding) {
        let (at, name, value) = match at {
            Spot::Tag(open) => (self.tag(open.node), "", ""),
            Spot::Attribute((a, name)) => (self.range(&a.range()), name, a.value()),
            Spot::Value((a, name)) => (self.value_range(&a), name, a.value()),
        };
        self.tell(code, at, |f| finding(f, name, value));
    }
}

fn misplaced(known: bool) -> Code {
    if known { Code::MisplacedElement } else { Code::UnknownElement }
}

fn wrong_child(known: bool, name: &str, parent: &str) -> String {
    if known {
        format!("`{name}` may not stand here in `{parent}`")
    } else {
        format!("unknown element `{}`", shown(name))
    }
}
