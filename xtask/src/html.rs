//! What the pages have in common.

/// How they look.
pub(crate) const STYLE: &str = include_str!("html.css");

/// Text as HTML shows it, in elements and quoted attributes.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}
