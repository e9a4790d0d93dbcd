//! From a place in a linked shader back to a line of the WESL file it came from.
//!
//! Linking renames, reorders and reformats, but within a declaration the words (names and numbers) stay the same
//! words in the same order. So the n-th word of a declaration in the linked text is the n-th word of its source.

use std::ops::Range;

use wesl::{EscapeMangler, Mangler, ModulePath, syntax::PathOrigin};

/// File and line of a byte of the linked text.
pub(super) fn line(
    wgsl: &str,
    at: usize,
    root: &ModulePath,
    find: &dyn Fn(&ModulePath) -> Option<(String, &'static str)>,
) -> (String, u32) {
    let unknown = || ("linked shader".to_owned(), line_of(wgsl, at));
    let Some((start, name)) = declarations(wgsl)
        .into_iter()
        .rev()
        .find(|(start, _)| *start <= at)
    else {
        return unknown();
    };
    let (path, item) = unmangled(name, root);
    let Some((file, source)) = find(&path) else {
        return unknown();
    };
    let Some(begin) = declaration(source, &item) else {
        return (file, 0);
    };
    let index = words(&wgsl[start..])
        .take_while(|word| start + word.end <= at)
        .count();
    let word = words(&source[begin..]).nth(index);
    let offset = word.map_or(begin, |word| begin + word.start);
    (file, line_of(source, offset))
}

/// The module and the name that a name of the linked text stands for; those of the root module keep theirs.
pub(super) fn unmangled(name: &str, root: &ModulePath) -> (ModulePath, String) {
    EscapeMangler
        .unmangle(name)
        .filter(|(path, _)| path.origin == PathOrigin::Absolute && !path.components.is_empty())
        .unwrap_or_else(|| (root.clone(), name.to_owned()))
}

/// The line, from 1, of a byte.
pub(super) fn line_of(text: &str, at: usize) -> u32 {
    let before = text.as_bytes().iter().take(at);
    1 + before.filter(|&&byte| byte == b'\n').count() as u32
}

/// Where the declaration of a name begins: at the keyword.
pub(super) fn declaration(text: &str, name: &str) -> Option<usize> {
    declarations(text)
        .into_iter()
        .find(|(_, own)| *own == name)
        .map(|(start, _)| start)
}

/// The keyword's byte and the name of every declaration at module scope.
fn declarations(text: &str) -> Vec<(usize, &str)> {
    const KEYWORDS: [&str; 6] = ["fn", "struct", "const", "var", "alias", "override"];
    let mut found = Vec::new();
    let mut depth = 0_usize;
    let mut rest = 0;
    for word in words(text) {
        for byte in code(text, rest..word.start) {
            match byte {
                b'{' => depth += 1,
                b'}' => depth = depth.saturating_sub(1),
                _ => {}
            }
        }
        rest = word.end;
        if depth == 0 && KEYWORDS.contains(&&text[word.clone()]) {
            // `var<storage, read> name`: what stands in angle brackets is not the name.
            let mut after = word.end;
            if text[after..].starts_with('<') {
                after += text[after..].find('>').unwrap_or(0);
            }
            if let Some(name) = words(&text[after..]).next() {
                found.push((word.start, &text[after + name.start..after + name.end]));
            }
        }
    }
    found
}

/// The bytes of a range that are not in comments; ranges lie between words, so they do not begin in one.
fn code(text: &str, range: Range<usize>) -> impl Iterator<Item = u8> + '_ {
    let mut at = range.start;
    std::iter::from_fn(move || {
        at = skip_comment(text, at);
        let byte = (at < range.end).then(|| text.as_bytes()[at]);
        at += 1;
        byte
    })
}

/// The names and numbers of a text, comments left out. A path `a::b` is one word, as it is after linking.
fn words(text: &str) -> impl Iterator<Item = Range<usize>> + '_ {
    let bytes = text.as_bytes();
    let mut at = 0;
    let is_word =
        |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'.' || byte >= 0x80;
    std::iter::from_fn(move || {
        loop {
            at = skip_comment(text, at);
            let byte = *bytes.get(at)?;
            if byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 0x80 {
                break;
            }
            at += 1;
        }
        let start = at;
        // A dot belongs to a number, but not to a name.
        let number = bytes[start].is_ascii_digit();
        while at < bytes.len()
            && ((is_word(bytes[at]) && (number || bytes[at] != b'.'))
                || bytes[at..].starts_with(b"::"))
        {
            at += if bytes[at] == b':' { 2 } else { 1 };
        }
        Some(start..at)
    })
}

/// The byte after the comments that begin at a byte; the byte itself where none does.
fn skip_comment(text: &str, mut at: usize) -> usize {
    let bytes = text.as_bytes();
    loop {
        let length = match bytes.get(at..at + 2) {
            Some(b"//") => text[at..].find('\n'),
            Some(b"/*") => text[at..].find("*/").map(|length| length + 2),
            _ => return at,
        };
        at = length.map_or(bytes.len(), |length| at + length);
    }
}
