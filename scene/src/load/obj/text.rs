//! From bytes to lines, words and numbers.

use std::borrow::Cow;

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};

use crate::{
    Result,
    load::budget::{Borrowed, Budget},
};

/// Decodes a text by its byte order mark; without one, as UTF-8, else UTF-16 where every other byte is zero, else
/// the Latin alphabet of Windows.
pub(super) fn decode<'a, 'b>(
    bytes: &'a [u8],
    budget: &'b Budget<'_>,
) -> Result<(Cow<'a, str>, Borrowed<'b>)> {
    let marked = Encoding::for_bom(bytes).map(|(encoding, _)| encoding);
    let encoding = marked.unwrap_or_else(|| match bytes {
        [0, other, ..] if *other != 0 => UTF_16BE,
        [other, 0, ..] if *other != 0 => UTF_16LE,
        _ if std::str::from_utf8(bytes).is_ok() => UTF_8,
        _ => WINDOWS_1252,
    });
    // Decoded text takes at most three bytes for each that is no UTF-8.
    let copied = encoding != UTF_8 || std::str::from_utf8(bytes).is_err();
    let size = if copied { 3 * bytes.len() as u64 } else { 0 };
    let held = budget.borrow("decoding the text", size)?;
    Ok((encoding.decode(bytes).0, held))
}

/// The lines of a text, ended by LF, CR LF or, of old, CR; a backslash at the end continues a line.
pub(super) fn lines(text: &str) -> impl Iterator<Item = Cow<'_, str>> {
    let end = if text.contains('\n') { '\n' } else { '\r' };
    let mut rest = text.split(end).map(str::trim_end);
    std::iter::from_fn(move || {
        let mut line = Cow::Borrowed(rest.next()?);
        while let Some(start) = line.strip_suffix('\\').map(str::len) {
            let line = line.to_mut();
            line.truncate(start);
            let Some(next) = rest.next() else { break };
            line.push(' ');
            line.push_str(next);
        }
        Some(line)
    })
}

/// A line's first word and the rest, trimmed; `None` for empty lines and comments.
pub(super) fn statement(line: &str) -> Option<(&str, &str)> {
    let line = line.trim();
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (!word.is_empty() && !word.starts_with('#')).then(|| (word, rest.trim_start()))
}

/// The words of a statement up to a comment.
pub(super) fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace()
        .take_while(|word| !word.starts_with('#'))
}

/// A number; of a word that only begins with one, that one; else NaN. `1.#IND` and its like are NaN.
pub(super) fn number(word: &str) -> f32 {
    word.parse().unwrap_or_else(|_| {
        if word.contains('#') {
            return f32::NAN;
        }
        let end = word.find(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)));
        let mut word = &word[..end.unwrap_or(word.len())];
        while !word.is_empty() {
            if let Ok(number) = word.parse() {
                return number;
            }
            word = &word[..word.len() - 1];
        }
        f32::NAN
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn continued_lines_are_joined() {
        let joined = |text| lines(text).collect::<Vec<_>>();
        assert_eq!(
            joined("a \\\nb\r\nc\\ \r\nd\\\n\ne\\"),
            ["a  b", "c d ", "e"]
        );
        assert_eq!(joined("a\\\rb\rc"), ["a b", "c"]);
    }

    #[test]
    fn numbers_of_every_dialect() {
        for (word, value) in [
            ("+1.", 1.0),
            (".5e1", 5.0),
            ("3.1+e2", 3.1),
            ("-2.5f", -2.5),
            ("1e400", f32::INFINITY),
        ] {
            assert_eq!(number(word), value, "{word}");
        }
        for word in ["nan", "-nan", "1.#IND", "x", "", "-", "é1"] {
            assert!(number(word).is_nan(), "{word}");
        }
    }

    #[test]
    fn every_encoding_gives_the_same_text() {
        let budget = Budget::new(Path::new(""), 1000);
        let utf16 = |swap: bool| -> Vec<u8> {
            "\u{feff}v é"
                .encode_utf16()
                .flat_map(|unit| {
                    if swap {
                        unit.to_be_bytes()
                    } else {
                        unit.to_le_bytes()
                    }
                })
                .collect()
        };
        let texts: [&[u8]; 6] = [
            "v é".as_bytes(),
            "\u{feff}v é".as_bytes(),
            &utf16(true),
            &utf16(false),
            &utf16(true)[2..],
            b"v \xe9",
        ];
        for bytes in texts {
            assert_eq!(decode(bytes, &budget).unwrap().0, "v é", "{bytes:?}");
        }
    }
}
