//! Inputs near others.

use crate::generate::Random;

/// Numbers at the ends of things, as bytes and as text.
const NUMBERS: [u64; 12] =
    [0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0xffff, 1 << 16, 0x7fff_ffff, 0xffff_ffff, 1 << 32, u64::MAX];
const WRITTEN: [&str; 12] =
    ["0", "-0", "-1", "1e308", "1e-320", "1e999", "nan", "inf", "4294967296", "18446744073709551616", "0.1", ""];

/// Changes `input` in one to eight places: bits, bytes, numbers, pieces doubled, cut out, or taken from `others`, and
/// `words` of the input's language.
pub fn mutate(input: &mut Vec<u8>, others: &[Vec<u8>], words: &[&str], random: &mut Random) {
    for _ in 0..=random.below(8) {
        once(input, others, words, random);
    }
}

fn once(input: &mut Vec<u8>, others: &[Vec<u8>], words: &[&str], random: &mut Random) {
    let length = input.len() as u64;
    let at = random.below(length + 1) as usize;
    let short = |random: &mut Random, rest: usize| {
        let most = 1 << random.below(10);
        (random.below(most) as usize).min(rest)
    };
    match random.below(11) {
        0..2 if length > 0 => input[at % length as usize] ^= 1 << random.below(8),
        2 if length > 0 => input[at % length as usize] = random.bits() as u8,
        3 => {
            let end = at + short(random, input.len() - at);
            input.drain(at..end);
        }
        4 => {
            let end = at + short(random, input.len() - at);
            let piece = input[at..end].to_vec();
            let to = random.below(length + 1) as usize;
            input.splice(to..to, piece);
        }
        5 => {
            let wide = [1, 2, 4, 8][random.below(4) as usize];
            let bytes = NUMBERS[random.below(NUMBERS.len() as u64) as usize].to_le_bytes();
            for (to, byte) in input[at..].iter_mut().zip(&bytes[..wide]) {
                *to = *byte;
            }
        }
        6 => {
            let other = &others[random.below(others.len() as u64) as usize];
            let from = random.below(other.len() as u64 + 1) as usize;
            let end = from + short(random, other.len() - from);
            input.splice(at..at, other[from..end].iter().copied());
        }
        7 if !words.is_empty() => {
            let word = words[random.below(words.len() as u64) as usize];
            input.splice(at..at, word.bytes());
        }
        8 => {
            // A number that is written out becomes another one.
            let Some(from) = input[at..].iter().position(u8::is_ascii_digit).map(|n| at + n) else { return };
            let digits = input[from..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
            let number = WRITTEN[random.below(WRITTEN.len() as u64) as usize];
            input.splice(from..from + digits, number.bytes());
        }
        9 => input.truncate(at),
        _ => {
            let count = short(random, 64);
            let bytes: Vec<u8> = (0..count).map(|_| random.bits() as u8).collect();
            input.splice(at..at, bytes);
        }
    }
}
