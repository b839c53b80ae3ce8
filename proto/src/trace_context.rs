//! Where a span stands in a trace, as calls carry it: the header `traceparent` of W3C Trace Context.

use std::fmt;

use tonic::metadata::{MetadataMap, MetadataValue};

/// The key in a call's metadata.
const KEY: &str = "traceparent";
/// Characters of version 00.
const LENGTH: usize = 55;
/// The flag that says that the trace is recorded.
const SAMPLED: u8 = 1;

/// A span that others may hang theirs under.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceContext {
    /// The trace; not 0.
    pub trace: u128,
    /// The span; not 0.
    pub span: u64,
    /// Whether the trace is recorded.
    pub sampled: bool,
}

impl TraceContext {
    /// What a peer says; `None` where it is not as the specification has it.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let bytes = text.as_bytes();
        let (known, rest) = bytes.split_at_checked(LENGTH)?;
        let version = hex(&known[..2])?;
        // Later versions may say more, after another hyphen.
        let fits = if version == 0 { rest.is_empty() } else { rest.first().is_none_or(|&b| b == b'-') };
        if version == 0xff || !fits || [2, 35, 52].iter().any(|&at| known[at] != b'-') {
            return None;
        }
        let (trace, span) = (hex(&known[3..35])?, hex(&known[36..52])?);
        let flags = hex(&known[53..])?;
        let span = u64::try_from(span).ok()?;
        (trace != 0 && span != 0).then_some(Self { trace, span, sampled: flags & u128::from(SAMPLED) != 0 })
    }

    /// What a call's metadata say; `None` where they say nothing, more than one thing, or nothing sound.
    #[must_use]
    pub fn of(metadata: &MetadataMap) -> Option<Self> {
        let mut said = metadata.get_all(KEY).iter();
        let text = said.next()?.to_str().ok()?;
        if said.next().is_some() { None } else { Self::parse(text) }
    }

    /// Says it in a call's metadata.
    pub fn put(self, metadata: &mut MetadataMap) {
        // What is written is always a header's value.
        if let Ok(value) = MetadataValue::try_from(self.to_string()) {
            metadata.insert(KEY, value);
        }
    }
}

impl fmt::Display for TraceContext {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "00-{:032x}-{:016x}-{:02x}", self.trace, self.span, u8::from(self.sampled) * SAMPLED)
    }
}

/// Digits 0 to 9 and a to f, 32 at most.
fn hex(digits: &[u8]) -> Option<u128> {
    digits.iter().try_fold(0, |number, &digit| {
        let digit = match digit {
            b'0'..=b'9' => digit - b'0',
            b'a'..=b'f' => digit - b'a' + 10,
            _ => return None,
        };
        Some(number << 4 | u128::from(digit))
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const GOOD: &str = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";

    #[test]
    fn what_the_specification_allows_is_read_and_nothing_else() {
        let read = TraceContext::parse(GOOD).unwrap();
        assert_eq!((read.trace >> 64, read.span, read.sampled), (0x0af7_6519_16cd_43dd, 0xb7ad_6b71_6920_3331, true));
        assert_eq!(read.to_string(), GOOD);
        let later = GOOD.replacen("00", "01", 1);
        for good in [&later, &format!("{later}-more"), &GOOD.replace("-01", "-ff")] {
            assert_eq!(TraceContext::parse(good), Some(read), "{good}");
        }
        let bad = [
            String::new(),
            GOOD[1..].into(),
            GOOD.to_uppercase(),
            GOOD.replacen("00", "ff", 1),
            format!("{GOOD}-more"),
            format!("{later}x"),
            GOOD.replace('-', "_"),
            GOOD.replace("b7", "+7"),
            GOOD.replace("0af7651916cd43dd8448eb211c80319c", &"0".repeat(32)),
            GOOD.replace("b7ad6b7169203331", &"0".repeat(16)),
            GOOD.replace("31-01", "é-01"),
        ];
        for bad in bad {
            assert_eq!(TraceContext::parse(&bad), None, "{bad}");
        }
    }

    #[test]
    fn metadata_say_it_once() {
        let mut metadata = MetadataMap::new();
        assert_eq!(TraceContext::of(&metadata), None);
        let context = TraceContext::parse(GOOD).unwrap();
        context.put(&mut metadata);
        assert_eq!(TraceContext::of(&metadata), Some(context));
        metadata.append(KEY, MetadataValue::from_static(GOOD));
        assert_eq!(TraceContext::of(&metadata), None);
    }

    proptest! {
        #[test]
        fn nothing_that_is_said_is_taken_for_another(text in "[ -~é]{0,60}") {
            if let Some(read) = TraceContext::parse(&text) {
                prop_assert_eq!(read.to_string()[3..53].to_owned(), text[3..53].to_owned());
            }
        }

        #[test]
        fn what_is_written_is_read(trace in 1u128.., span in 1u64.., sampled: bool) {
            let context = TraceContext { trace, span, sampled };
            prop_assert_eq!(TraceContext::parse(&context.to_string()), Some(context));
        }
    }
}
