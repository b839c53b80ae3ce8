//! All of a document but the world's children.
//!
//! The frame is what is left when the children are cut out: a small document of its
//! own, which is parsed and checked as one.

use std::ops::Range;

use super::assembly::Assembly;
use super::check::{Checker, Shift};
use super::diagnostic::Code;
use super::finding::{Finding, Findings, Limits};
use super::lex::{self, Kind, Token};
use super::part::Part;
use super::piece::{self, MAX_DEPTH, MAX_UNIT};
use super::{prolog, syntax};

/// Where the large pieces of a document lie.
#[derive(Debug)]
pub(super) struct Outline {
    /// What the parser is not shown: byte order mark, XML declaration, DOCTYPE.
    blanks: Vec<Range<usize>>,
    /// The `yes` of `standalone="yes"`.
    pub standalone: Option<Range<usize>>,
    /// The root's name.
    root: Option<Range<usize>>,
    /// The world's start tag.
    pub world: Option<Token>,
}

/// Walks through the text up to the world's start tag.
pub(super) fn outline(text: &str, start: usize, findings: &mut Findings) -> Outline {
    let mut outline = Outline { blanks: Vec::new(), standalone: None, root: None, world: None };
    let mut at = start;
    match prolog::declaration(text, start) {
        Ok(None) => {}
        Ok(Some(declaration)) => {
            at = declaration.end;
            outline.standalone = declaration.standalone;
        }
        Err(finding) => {
            findings.push(finding);
            at = memchr::memmem::find(&text.as_bytes()[at..], b"?>").map_or(start, |i| start + i + 2);
        }
    }
    outline.blanks.push(0..at);
    let mut depth = 0usize;
    while let Some(token) = lex::next(text, at) {
        let token = match token {
            Ok(token) => token,
            Err(broken) => {
                if broken.finding.code == Code::InternalSubset {
                    findings.push(broken.finding);
                    return outline;
                }
                // The frame's check will report it; the children can be read all the same.
                let from = broken.resume.min(text.len());
                let found = memchr::memmem::find_iter(&text.as_bytes()[from..], b"<world")
                    .find_map(|i| lex::next(text, from + i)?.ok().filter(|t| is_world(text, t)));
                outline.world = found;
                return outline;
            }
        };
        at = token.at.end;
        match token.kind {
            Kind::Start { .. } if depth == 1 && is_world(text, &token) => {
                outline.world = Some(token);
                return outline;
            }
            Kind::Start { empty } => {
                if depth == 0 && outline.root.is_none() {
                    outline.root = Some(token.name);
                }
                depth += usize::from(!empty);
            }
            Kind::End => depth = depth.saturating_sub(1),
            Kind::Doctype if depth == 0 && outline.root.is_none() && outline.blanks.len() == 1 => {
                outline.blanks.push(token.at);
                for finding in token.findings {
                    findings.push(finding);
                }
            }
            _ => {}
        }
    }
    outline
}

fn is_world(text: &str, token: &Token) -> bool {
    matches!(token.kind, Kind::Start { .. }) && &text[token.name.clone()] == "world"
}

/// Checks the frame. `close` is the world's end tag, the inner `None` if there is none;
/// the outer `None` if no children were cut out. `findings` are those of the outline.
#[expect(clippy::option_option, reason = "no children and no end tag are different things")]
pub(super) fn check(
    text: &str,
    outline: &Outline,
    close: Option<Option<Range<usize>>>,
    limits: Limits,
    findings: Findings,
    assembly: &mut Assembly<'_>,
) {
    let head = match (&outline.world, &close) {
        (Some(world), Some(_)) => world.at.end,
        _ => text.len(),
    };
    let tail = match &close {
        Some(Some(close)) => close.start,
        _ => text.len(),
    };
    let mut part = Part::new(limits);
    part.findings.append(findings);
    if head + text.len() - tail > MAX_UNIT {
        let at = outline.world.as_ref().map_or(outline.root.clone().unwrap_or(0..0), |w| w.name.clone());
        let finding = if outline.world.is_some() {
            Finding::new(Code::TooLarge, at, format!("more than {} MiB stand around this `world`", MAX_UNIT >> 20))
        } else {
            Finding::new(Code::TooLarge, at, format!("there is no `world` in these {} MiB", text.len() >> 20))
        };
        part.findings.push(finding.expected("camera, then background if any, then world with all objects in it"));
        return assembly.add(part);
    }

    let mut source = String::with_capacity(head + text.len() - tail + 32);
    let mut at = 0;
    for blank in &outline.blanks {
        source.push_str(&text[at..blank.start]);
        source.extend(std::iter::repeat_n(' ', blank.len()));
        at = blank.end;
    }
    source.push_str(&text[at..head]);
    source.push_str(&text[tail..]);
    let unclosed = close == Some(None);
    if unclosed {
        // That the world does not end was reported; what stands before it can be checked.
        let root = outline.root.clone().map_or("scene", |r| &text[r]);
        source.push_str("</world></");
        source.push_str(root);
        source.push('>');
    }
    let shift = Shift { cut: head, before: 0, behind: tail as isize - head as isize };
    let mut good = guard(&source, shift, &mut part);
    if unclosed && outline.root.is_none() {
        good = false; // the root's start tag was too broken to be closed
    }
    if good {
        match roxmltree::Document::parse(&source) {
            Ok(tree) => {
                add_frame(tree.root_element(), &source, shift, &mut part, assembly);
            }
            Err(error) => part.findings.push(syntax::finding(&error, &source, shift)),
        }
    }
    assembly.add(part);
}

/// Adds what stands around the world, checked.
fn add_frame(root: roxmltree::Node<'_, '_>, source: &str, shift: Shift, part: &mut Part, assembly: &mut Assembly<'_>) {
    let frame = Checker { source, shift, part }.scene(root);
    if let Some(camera) = frame.camera
        && let Err(invalid) = assembly.scene.camera(camera.location, camera.sky, camera.look_at)
    {
        part.findings.push(Finding::new(Code::CameraView, 0..0, invalid.to_string()));
    }
    if let Some(background) = frame.background
        && let Err(invalid) = assembly.scene.background(background)
    {
        part.findings.push(Finding::new(Code::Range, 0..0, invalid.to_string()));
    }
    if let Some(world) = frame.world
        && !assembly.lit
        && !part.lit()
        && assembly.findings.errors + part.findings.errors == 0
    {
        part.findings.push(
            Finding::new(Code::NoLight, world, "this `world` has no light: all surfaces will be black")
                .expected("<light><position><vector …/></position></light>"),
        );
    }
}

/// Looks through the frame for what the parser must not see, or would not mind.
fn guard(source: &str, shift: Shift, part: &mut Part) -> bool {
    let mut good = true;
    let mut open: Vec<Range<usize>> = Vec::new();
    let mut at = 0;
    let mut report = |finding: Finding| {
        let by = shift.at(finding.at.start);
        let len = finding.at.len();
        part.findings.push(Finding { at: by..by + len, ..finding });
    };
    while let Some(token) = lex::next(source, at) {
        let token = match token {
            Ok(token) => token,
            Err(broken) => {
                report(broken.finding);
                return false;
            }
        };
        at = token.at.end;
        match token.kind {
            Kind::Start { empty } => {
                if open.len() >= MAX_DEPTH {
                    report(piece::too_deep(token.name));
                    return false;
                }
                if !empty {
                    open.push(token.name);
                }
            }
            Kind::End => {
                let name = &source[token.name.clone()];
                match open.iter().rposition(|o| &source[o.clone()] == name) {
                    Some(depth) => {
                        if depth + 1 < open.len() {
                            report(piece::mismatch(source, &open[open.len() - 1], &token));
                            good = false;
                        }
                        open.truncate(depth);
                    }
                    None => {
                        report(piece::stray_end(source, &token));
                        good = false;
                    }
                }
            }
            Kind::Cdata => {
                let parent = open.last().map_or("document", |o| &source[o.clone()]);
                report(piece::cdata(&token, parent));
                good = false;
            }
            Kind::Doctype => {
                report(piece::late_doctype(&token));
                good = false;
            }
            Kind::Comment | Kind::Instruction => {}
        }
        for finding in token.findings {
            report(finding);
            good = false;
        }
    }
    if let (Some(name), true) = (open.last(), good) {
        report(piece::unclosed(source, name.clone()));
        good = false;
    }
    good
}
