//! The fast lane: world children in the shapes that programs write, read in one pass
//! without tree or allocation.
//!
//! It takes an object only if it is certain that the careful way would take it too,
//! with the same numbers and without a word; whatever is out of the ordinary, be it a
//! comment, an entity, another order of attributes, a warning or an error, it leaves
//! unread. So nothing here reports anything.

use super::diagnostic::Code;
use super::finding::Finding;
use super::grammar::{self, Model};
use super::lex::is_space;
use super::meaning::{self, Elements, Spot};
use super::number::{self, Scanned};
use super::part::{Finish, Object, Paint, Part};

/// A cursor over a document's bytes.
#[derive(Debug)]
pub(super) struct Fast<'t> {
    bytes: &'t [u8],
    at: usize,
    /// Whether something out of the ordinary was met.
    refused: bool,
    /// The surface of the object read last, and as it is written, unless it is that of the object before.
    surface: Option<(Finish, &'t [u8])>,
    /// The file that it names, and where.
    file: Option<(&'t str, usize)>,
    /// The last surface taken, as written, and its number: runs of equal ones are common.
    last_surface: (&'t [u8], u32),
}

/// An element that is open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Open {
    name: &'static str,
    model: &'static Model,
}

impl<'t> Fast<'t> {
    pub(super) fn new(bytes: &'t [u8]) -> Self {
        Self { bytes, at: 0, refused: false, surface: None, file: None, last_surface: (&[], 0) }
    }

    /// The object that begins at `at`, behind white space if any, and where it ends. Until it is taken,
    /// its surface has no number.
    pub(super) fn object(&mut self, at: usize) -> Option<(Object, usize)> {
        (self.at, self.refused, self.surface, self.file) = (at, false, None, None);
        self.space();
        let first = self.bytes.get(self.at + 1)?;
        let name = grammar::OBJECTS.into_iter().find(|name| name.as_bytes()[0] == *first)?;
        let object = meaning::object(self, name)?;
        (!self.refused).then_some((object, self.at))
    }

    /// Takes the `object` read last into `part`.
    pub(super) fn take(&mut self, mut object: Object, part: &mut Part) {
        if let Some((mut finish, written)) = self.surface {
            if let Some((name, at)) = self.file {
                finish.paint = Paint::File(part.file(name, at..at + name.len()));
            }
            let number = part.surface(finish);
            match &mut object {
                Object::Triangle(t) => t.surface = number,
                Object::Sphere(s) => s.surface = number,
                Object::Plane(p) => p.surface = number,
                Object::Light(_) => {}
            }
            if !written.is_empty() {
                self.last_surface = (written, number);
            }
        }
        part.push(object);
    }

    /// Leaves the object to the careful way.
    #[cold]
    fn refuse(&mut self) {
        self.refused = true;
        self.at = self.bytes.len();
    }

    #[inline(always)]
    fn rest(&self) -> &'t [u8] {
        &self.bytes[self.at..]
    }

    #[inline(always)]
    fn space(&mut self) {
        while self.bytes.get(self.at).copied().is_some_and(is_space) {
            self.at += 1;
        }
    }

    #[inline(always)]
    fn eat(&mut self, word: &str) -> Option<()> {
        let there = self.rest().starts_with(word.as_bytes());
        self.at += if there { word.len() } else { 0 };
        there.then_some(())
    }

    /// White space if any, then `word`.
    #[inline(always)]
    fn next(&mut self, word: &str) -> Option<()> {
        self.space();
        self.eat(word)
    }

    /// Whether an element called `name` begins here, behind white space if any.
    #[inline(always)]
    fn ahead(&mut self, name: &str) -> bool {
        self.space();
        let tag = self.rest().strip_prefix(b"<").and_then(|r| r.strip_prefix(name.as_bytes()));
        tag.is_some_and(|r| r.first().is_some_and(|b| is_space(*b) || matches!(b, b'>' | b'/')))
    }

    /// The number in an attribute. A file's name is kept beside.
    #[inline(always)]
    fn value(&mut self, name: &str) -> Option<f64> {
        self.bytes.get(self.at).filter(|b| is_space(**b))?;
        self.next(name)?;
        self.next("=")?;
        self.space();
        let quote = *self.bytes.get(self.at).filter(|b| matches!(b, b'"' | b'\''))?;
        self.at += 1;
        if name == grammar::FILE {
            return self.file_name(quote);
        }
        let Scanned { value, len, nonzero } = number::scan(self.rest())?;
        self.bytes.get(self.at + len).filter(|b| **b == quote)?;
        self.at += len + 1;
        // Neither too large nor too small.
        (value.is_finite() && (value != 0.0 || !nonzero)).then_some(value)
    }

    fn file_name(&mut self, quote: u8) -> Option<f64> {
        let len = memchr::memchr(quote, self.rest())?;
        let name = &self.rest()[..len];
        if name.is_empty() || !name.iter().all(|b| (b' '..=b'~').contains(b) && !matches!(b, b'<' | b'&')) {
            return None;
        }
        self.file = Some((std::str::from_utf8(name).ok()?, self.at));
        self.at += len + 1;
        Some(0.0)
    }

    #[inline(always)]
    fn end(&mut self, open: &Open) -> Option<()> {
        let empty = open.model.slots.is_empty();
        if empty && self.next("/>").is_some() {
            return Some(());
        }
        if empty { self.eat("></") } else { self.next("</") }?;
        self.eat(open.name)?;
        self.next(">")
    }
}

impl Elements for Fast<'_> {
    const EXACT: bool = false;
    /// The name of one that begins here, behind white space if any.
    type Element = &'static str;
    type Open = Open;
    type Attribute = f64;

    #[inline(always)]
    fn open(&mut self, name: &'static str, model: &'static Model) -> Open {
        self.next("<").and_then(|()| self.eat(name)).unwrap_or_else(|| self.refuse());
        Open { name, model }
    }

    #[inline(always)]
    fn open_either(&mut self, name: &'static str, first: &'static Model, _: &'static Model) -> Open {
        self.open(name, first)
    }

    #[inline(always)]
    fn second_form(&mut self, open: &Open, second: &'static Model, place: usize) -> Option<Open> {
        self.ahead(second.slots[place].names[0]).then_some(Open { model: second, ..*open })
    }

    #[inline(always)]
    fn attribute(&mut self, open: &Open, place: usize) -> Option<f64> {
        let (known, here) = (&open.model.attributes[place], self.at);
        self.value(known.name).or_else(|| {
            self.at = here;
            known.required.then(|| self.refuse()).map(|()| 0.0)
        })
    }

    #[inline(always)]
    fn child(&mut self, open: &Open, place: usize) -> Option<&'static str> {
        if place == 0 {
            self.next(">").unwrap_or_else(|| self.refuse());
        }
        let slot = &open.model.slots[place];
        match slot.names {
            // Whether it is there, opening it tells.
            [name] if slot.required => Some(name),
            names => names.iter().copied().find(|n| self.ahead(n)),
        }
    }

    #[inline(always)]
    fn close(&mut self, open: &Open) {
        self.end(open).unwrap_or_else(|| self.refuse());
    }

    fn name<'e>(name: &'e &'static str) -> &'e str {
        name
    }

    #[inline(always)]
    fn number(&mut self, number: f64) -> Option<f64> {
        Some(number)
    }

    fn file(&mut self, _: f64) -> Option<u32> {
        Some(0)
    }

    #[inline(always)]
    fn surface(&mut self, element: Option<&'static str>) -> Option<u32> {
        let (start, (written, number)) = (self.at, self.last_surface);
        if element.is_some() && !written.is_empty() && self.rest().starts_with(written) {
            self.at += written.len();
            return Some(number);
        }
        let finish = element.map_or(Some(Finish::default()), |e| meaning::surface(self, e))?;
        self.surface = Some((finish, if element.is_some() { &self.bytes[start..self.at] } else { &[] }));
        Some(0)
    }

    #[inline(always)]
    fn find(&mut self, _: Code, _: Spot<'_, Self>, _: impl FnOnce(Finding, &str, &str) -> Finding) {
        self.refuse();
    }
}
