//! Curves, as SVG.

use anyhow::{Result, anyhow};
use plotters::prelude::*;

/// Pixels of a plot.
const SIZE: (u32, u32) = (540, 360);
const COLORS: [RGBColor; 4] = [
    RGBColor(242, 176, 74),
    RGBColor(110, 180, 240),
    RGBColor(160, 210, 110),
    RGBColor(230, 120, 150),
];
const BACK: RGBColor = RGBColor(34, 36, 39);
const SOFT: RGBColor = RGBColor(157, 161, 166);
const LINE: RGBColor = RGBColor(58, 61, 66);

/// Curves over a quantity that grows by factors; both axes are logarithmic.
pub(super) struct Plot<'a> {
    pub(super) title: &'a str,
    pub(super) x: &'a str,
    pub(super) curves: Vec<Curve>,
}

/// Points of positive coordinates.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
}

impl Plot<'_> {
    /// The picture.
    pub(super) fn svg(&self) -> Result<String> {
        let mut svg = String::new();
        self.draw(&mut svg)
            .map_err(|error| anyhow!("the plot '{}': {error}", self.title))?;
        Ok(svg)
    }

    fn draw(&self, svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
        let all = || self.curves.iter().flat_map(|curve| &curve.points);
        let x = range(all().map(|point| point.0), 1.0);
        let y = range(all().map(|point| point.1), 1.5);
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&BACK)?;
        let mut chart = ChartBuilder::on(&root)
            .margin(14)
            .caption(self.title, ("sans-serif", 16).into_font().color(&SOFT))
            .x_label_area_size(34)
            .y_label_area_size(52)
            .build_cartesian_2d(x.log_scale(), y.log_scale())?;
        let text = ("sans-serif", 12).into_font().color(&SOFT);
        chart
            .configure_mesh()
            .axis_style(SOFT)
            .bold_line_style(LINE)
            .light_line_style(TRANSPARENT)
            .label_style(text.clone())
            .axis_desc_style(text.clone())
            .x_desc(self.x)
            .x_label_formatter(&short)
            .y_label_formatter(&short)
            .draw()?;
        for (curve, color) in self.curves.iter().zip(COLORS.iter().cycle()) {
            let points = || curve.points.iter().copied();
            chart
                .draw_series(LineSeries::new(points(), color.stroke_width(2)))?
                .label(&curve.name)
                .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
            chart.draw_series(points().map(|point| Circle::new(point, 3, color.filled())))?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerLeft)
            .background_style(BACK.mix(0.8))
            .label_font(text)
            .draw()?;
        root.present()?;
        Ok(())
    }
}

/// From the least to the greatest value, with room.
fn range(values: impl Iterator<Item = f64>, room: f64) -> std::ops::Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0.0_f64), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    if low < high {
        low / room..high * room
    } else {
        0.5 * low..2.0 * low
    }
}

/// 1500000 as 1.5M.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "plotters passes numbers so"
)]
fn short(value: &f64) -> String {
    match *value {
        value if value >= 1e6 => format!("{}M", value / 1e6),
        value if value >= 1e4 => format!("{}k", value / 1e3),
        value => format!("{value}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_become_lines() {
        let plot = Plot {
            title: "cost",
            x: "triangles",
            curves: vec![Curve {
                name: "maps".to_owned(),
                points: vec![(1e3, 2.0), (1e6, 2.1)],
            }],
        };
        let svg = plot.svg().expect("a plot");
        assert!(svg.starts_with("<svg") && svg.contains("polyline") && svg.contains("maps"));
        assert_eq!(short(&2e6), "2M");
    }
}
