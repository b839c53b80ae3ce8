//! Decimal floating point as XML authors write it, read as the nearest f64.
//!
//! The grammar is `[+-]? (digits [. digits?]? | . digits) ([eE] [+-]? digits)?`,
//! which shuts out the `inf` and `nan` that `fast-float2` takes, and the exponent
//! without digits that it leaves unread.

/// A number at the beginning of a byte string.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scanned {
    /// The nearest f64; infinite where it overflows.
    pub value: f64,
    /// Bytes it takes.
    pub len: usize,
    /// Whether any digit of it is not 0: where the value is 0 all the same, it underflowed.
    pub nonzero: bool,
}

/// Reads the number that `bytes` begins with, if it begins with one.
#[inline]
pub(super) fn scan(bytes: &[u8]) -> Option<Scanned> {
    let signed = matches!(bytes.first()?, b'+' | b'-');
    // Digits alone: no infinity, no NaN.
    if !matches!(bytes.get(usize::from(signed))?, b'0'..=b'9' | b'.') {
        return None;
    }
    let (value, len) = fast_float2::parse_partial::<f64, _>(bytes).ok()?;
    let exponent = |b: &u8| matches!(b, b'e' | b'E');
    if bytes.get(len).is_some_and(exponent) && !bytes[..len].iter().any(exponent) {
        return None;
    }
    let nonzero = value != 0.0 || bytes[..len].iter().take_while(|b| !exponent(b)).any(|b| (b'1'..=b'9').contains(b));
    Some(Scanned { value, len, nonzero })
}

/// Why a text is not a number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum NotANumber {
    Empty,
    /// NaN or infinity by name.
    NotFinite,
    /// Something that is no decimal number; with what was probably meant.
    Malformed(Option<String>),
    /// Its magnitude exceeds f64's.
    Overflow,
}

/// Reads the whole of `text` as one number, XML white space around it allowed.
/// Gives the value and whether it underflowed to 0.
pub(super) fn parse(text: &str) -> Result<(f64, bool), NotANumber> {
    let text = text.trim_matches([' ', '\t', '\r', '\n']);
    match scan(text.as_bytes()) {
        Some(Scanned { value, len, nonzero }) if len == text.len() => {
            if value.is_finite() {
                Ok((value, nonzero && value == 0.0))
            } else {
                Err(NotANumber::Overflow)
            }
        }
        _ if text.is_empty() => Err(NotANumber::Empty),
        _ => {
            let bare = text.trim_start_matches(['+', '-']).to_ascii_lowercase();
            if ["nan", "inf", "infinity"].contains(&bare.as_str()) {
                return Err(NotANumber::NotFinite);
            }
            let meant = (text.len() <= 64).then(|| text.replace(',', ".").replace('−', "-"));
            let meant = meant.filter(|m| scan(m.as_bytes()).is_some_and(|s| s.len == m.len() && s.value.is_finite()));
            Err(NotANumber::Malformed(meant))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_nearest_f64() {
        for text in [
            "0",
            "-0.5",
            "1e-3",
            ".5",
            "+2",
            "5.",
            " 7\t",
            "-.5e+1",
            "0.746856609",
            "9007199254740993",
            "1e22",
            "1e23",
            "123456789012345678901234567890",
            "2.2250738585072011e-308",
            "5e-324",
            "1.7976931348623157e308",
            "0.000000000000000000000000000000000001",
            "00000000000000000000000001.5",
            "4.35",
            "1E5",
            "-0",
            "9007199254740991e-22",
            "9007199254740992e1",
        ] {
            let want: f64 = text.trim().parse().expect("std reads it too");
            let (got, underflow) = parse(text).unwrap_or_else(|e| panic!("{text}: {e:?}"));
            assert_eq!(got.to_bits(), want.to_bits(), "{text}");
            assert!(!underflow, "{text}");
        }
    }

    #[test]
    fn agrees_with_std_on_many_texts() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        for _ in 0..200_000 {
            let digits = next() % 20;
            let mut text = String::new();
            for _ in 0..=digits {
                text.push(char::from(b'0' + (next() % 10) as u8));
            }
            text.insert(next() as usize % (text.len() + 1), '.');
            if next() % 2 == 0 {
                text += &format!("e{}", next() as i64 % 60 - 30);
            }
            let want: f64 = text.parse().expect("a number");
            assert_eq!(parse(&text).map(|(v, _)| v.to_bits()), Ok(want.to_bits()), "{text}");
        }
    }

    #[test]
    fn refuses_what_is_no_decimal_number() {
        for text in [
            "1..2", "1.2.3", "e5", "1e", "1e+", "0x10", "1 2", "12abc", "--1", "+-1", ".", "-", "1_000", "1f",
            "\u{a0}1", "١",
        ] {
            assert_eq!(parse(text), Err(NotANumber::Malformed(None)), "{text}");
        }
        assert_eq!(parse("1,5"), Err(NotANumber::Malformed(Some("1.5".into()))));
        assert_eq!(parse("−3"), Err(NotANumber::Malformed(Some("-3".into()))));
        for text in ["", " ", "\n"] {
            assert_eq!(parse(text), Err(NotANumber::Empty));
        }
        for text in ["NaN", "inf", "-Infinity", "+INF"] {
            assert_eq!(parse(text), Err(NotANumber::NotFinite), "{text}");
        }
    }

    #[test]
    fn overflow_is_refused_and_underflow_told() {
        assert_eq!(parse("1e309"), Err(NotANumber::Overflow));
        assert_eq!(parse(&format!("1{}", "0".repeat(400))), Err(NotANumber::Overflow));
        assert_eq!(parse("-1e99999999999999999999"), Err(NotANumber::Overflow));
        assert_eq!(parse("1e-400"), Ok((0.0, true)));
        assert_eq!(parse(&format!("0.{}1", "0".repeat(400))), Ok((0.0, true)));
        assert_eq!(parse("0e-99999999999999999999"), Ok((0.0, false)));
        assert_eq!(parse("0e99999999999999999999"), Ok((0.0, false)));
        assert_eq!(parse("5e-324"), Ok((5e-324, false)));
    }
}
