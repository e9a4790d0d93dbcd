//! Curves, as SVG.

use anyhow::{Result, anyhow};
use plotters::prelude::*;
use serde_json::Value;

use super::lab::number;

/// Pixels of a plot.
const SIZE: (u32, u32) = (540, 360);
const COLORS: [RGBColor; 6] = [
    RGBColor(242, 176, 74),
    RGBColor(110, 180, 240),
    RGBColor(160, 210, 110),
    RGBColor(230, 120, 150),
    RGBColor(190, 150, 240),
    RGBColor(90, 200, 190),
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

/// Points. What is 0 up the plot, such as the error of what is exact, is a ring at its foot.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
}

impl Curve {
    /// Of reports, the numbers at two places in each.
    pub(super) fn of<'a>(
        name: impl Into<String>,
        reports: impl IntoIterator<Item = &'a Value>,
        [x, y]: [&str; 2],
    ) -> Result<Self> {
        let points = reports.into_iter();
        let points = points.map(|report| Ok((number(report, x)?, number(report, y)?)));
        Ok(Self {
            name: name.into(),
            points: points.collect::<Result<_>>()?,
        })
    }

    /// What logarithmic axes can show.
    fn drawn(&self) -> impl Iterator<Item = (f64, f64)> {
        let points = self.points.iter().copied();
        points.filter(|(x, y)| *x > 0.0 && *y > 0.0)
    }

    /// Where there are zeros.
    fn zeros(&self) -> impl Iterator<Item = f64> {
        let points = self.points.iter();
        points.filter_map(|(x, y)| (*x > 0.0 && *y == 0.0).then_some(*x))
    }
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
        let drawn = || self.curves.iter().flat_map(Curve::drawn);
        let zeros = || self.curves.iter().flat_map(Curve::zeros);
        let x = range(drawn().map(|point| point.0).chain(zeros()), 1.05);
        let y = range(drawn().map(|point| point.1), 1.5);
        // The names stand below the curves.
        let names = (self.curves.len() as f64 * 16.0 + 34.0) / f64::from(SIZE.1 - 90);
        let foot = y.start / (y.end / y.start).powf(names / (1.0 - names));
        let y = foot..y.end;
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&BACK)?;
        let mut chart = ChartBuilder::on(&root)
            .margin(14)
            .caption(self.title, ("sans-serif", 16).into_font().color(&SOFT))
            .x_label_area_size(34)
            .y_label_area_size(52)
            .build_cartesian_2d(
                x.clone().log_scale().with_key_points(marks(&x, 9)),
                y.clone().log_scale().with_key_points(marks(&y, 7)),
            )?;
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
            chart
                .draw_series(LineSeries::new(curve.drawn(), color.stroke_width(2)))?
                .label(&curve.name)
                .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
            chart.draw_series(
                curve
                    .drawn()
                    .map(|point| Circle::new(point, 3, color.filled())),
            )?;
            chart.draw_series(
                curve
                    .zeros()
                    .map(|x| Circle::new((x, foot), 5, color.stroke_width(2))),
            )?;
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
    } else if high == 0.0 {
        // Nothing is drawn.
        1.0..10.0
    } else {
        0.5 * low..2.0 * low
    }
}

/// Powers of ten, and what is between them unless there are more than so many marks.
fn marks(range: &std::ops::Range<f64>, most: usize) -> Vec<f64> {
    let of = |steps: &[f64]| -> Vec<f64> {
        let [low, high] = [range.start, range.end].map(|end| end.log10().floor() as i32);
        let all = (low..=high).flat_map(|power| steps.iter().map(move |step| (step, power)));
        // A quotient for what is below 1: 3/10 is 0.3, but 3 times a tenth is not.
        let all = all.map(|(step, power)| match power {
            0.. => step * 10_f64.powi(power),
            _ => step / 10_f64.powi(-power),
        });
        all.filter(|mark| range.contains(mark)).collect()
    };
    let finest = of(&[
        1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0,
    ]);
    let fine = of(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    let choices = [finest, fine, of(&[1.0, 2.0, 5.0]), of(&[1.0, 3.0])];
    let fits = choices.into_iter().find(|marks| marks.len() <= most);
    fits.unwrap_or_else(|| of(&[1.0]))
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
    fn axes_are_marked_whatever_they_span() {
        assert_eq!(marks(&(0.26..0.55), 5), [0.3, 0.35, 0.4, 0.5]);
        assert_eq!(marks(&(0.04..3.0), 6), [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]);
        assert_eq!(marks(&(1.0..1e7), 8).len(), 7);
        assert!(marks(&(0.0011..0.0012), 5).is_empty());
    }

    #[test]
    fn curves_become_lines() {
        let plot = Plot {
            title: "cost",
            x: "triangles",
            curves: vec![Curve {
                name: "maps".to_owned(),
                points: vec![(1e3, 2.0), (1e6, 2.1), (1e7, 0.0)],
            }],
        };
        let svg = plot.svg().expect("a plot");
        assert!(svg.starts_with("<svg") && svg.contains("polyline") && svg.contains("maps"));
        assert_eq!(svg.matches("<circle").count(), 3);
        assert_eq!(short(&2e6), "2M");
        let of_exact = Plot {
            curves: vec![Curve {
                name: "exact".to_owned(),
                points: vec![(1.0, 0.0)],
            }],
            ..plot
        };
        assert!(of_exact.svg().expect("a plot").contains("exact"));
    }
}
