//! What the user should know about a file that loaded.

use std::cell::RefCell;

/// Enough to see what is wrong; a broken file can give one for each of its million parts.
const MOST: usize = 100;

/// A list of different warnings.
#[derive(Default)]
pub(super) struct Warnings(RefCell<List>);

#[derive(Default)]
struct List {
    lines: Vec<String>,
    more: usize,
}

impl Warnings {
    /// Adds a line unless it is there already.
    pub(super) fn add(&self, line: impl Into<String>) {
        let line = line.into();
        let mut list = self.0.borrow_mut();
        if list.lines.contains(&line) {
            return;
        }
        if list.lines.len() < MOST {
            list.lines.push(line);
        } else {
            list.more += 1;
        }
    }

    /// All lines, with a last one for those that were left out.
    pub(super) fn into_lines(self) -> Vec<String> {
        let List { mut lines, more } = self.0.into_inner();
        if more > 0 {
            lines.push(format!("and {more} further warnings"));
        }
        lines
    }
}
