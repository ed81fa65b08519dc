//! SVG pictures: series over two logarithmic axes, and the lower hull of time against error.

use std::path::Path;

use plotters::prelude::*;

use crate::Failure;

/// Colours that are told apart on white, by the colour-blind too.
const COLORS: [[u8; 3]; 12] = [
    [0, 92, 175],
    [213, 94, 0],
    [0, 140, 100],
    [170, 60, 140],
    [110, 80, 20],
    [60, 60, 60],
    [70, 160, 220],
    [190, 140, 0],
    [230, 110, 150],
    [140, 200, 60],
    [120, 60, 220],
    [0, 0, 0],
];

/// Points of one method.
#[derive(Clone, Debug)]
pub struct Series {
    /// What the legend says.
    pub name: String,
    /// x, y; what is not above 0 is drawn at the axis.
    pub points: Vec<[f64; 2]>,
}

/// One picture.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Names of the axes.
    pub axes: [String; 2],
    /// The methods.
    pub series: Vec<Series>,
    /// Mark the lower hull: methods worth keeping.
    pub hull: bool,
}

/// The points that no other beats on both axes and that no mix of two others beats: lower convex hull from the left-most
/// to the lowest.
pub fn lower_hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut hull: Vec<[f64; 2]> = Vec::new();
    for p in sorted {
        if hull.last().is_some_and(|last| p[1] >= last[1]) {
            continue;
        }
        while let [.., a, b] = hull[..] {
            if (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(p);
    }
    hull
}

/// 1, 2 and 5 of every power of ten in the range; the powers alone where that would be too many.
fn ticks(range: &std::ops::Range<f64>) -> Vec<f64> {
    let decades = range.start.log10().floor() as i32..=range.end.log10().ceil() as i32;
    let of = |steps: &'static [f64]| {
        let all = decades.clone().flat_map(move |d| steps.iter().map(move |s| s * 10f64.powi(d)));
        all.filter(|v| range.contains(v)).collect::<Vec<_>>()
    };
    let fine = of(&[1.0, 2.0, 5.0]);
    if fine.len() <= 12 { fine } else { of(&[1.0]) }
}

impl Plot {
    /// Writes the picture.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        self.draw(path).map_err(|e| Failure::target(format!("{}: {e}", path.display())))
    }

    fn draw(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        let all = || self.series.iter().flat_map(|s| &s.points);
        let range = |axis: usize| {
            let above = || all().map(|p| p[axis]).filter(|v| *v > 0.0 && v.is_finite());
            let (low, high) = (above().fold(f64::INFINITY, f64::min), above().fold(0.0, f64::max));
            let (low, high) = if low < high {
                (low, high)
            } else if high > 0.0 {
                (high, high)
            } else {
                (0.1, 1.0)
            };
            // Values of 0 lie on the axis: a decade below the least that is above it.
            let zero = all().any(|p| p[axis] <= 0.0);
            (low / if zero { 10.0 } else { 1.5 })..(high * 1.5)
        };
        let (x, y) = (range(0), range(1));
        let (least_x, least_y) = (x.start, y.start);
        let at = |p: &[f64; 2]| (p[0].max(least_x), p[1].max(least_y));
        let root = SVGBackend::new(path, (1120, 560)).into_drawing_area();
        root.fill(&WHITE)?;
        // The legend stands beside the picture: no place within is sure to be free.
        let (left, right) = root.split_horizontally(860);
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(76)
            .build_cartesian_2d(
                x.clone().log_scale().with_key_points(ticks(&x)),
                y.clone().log_scale().with_key_points(ticks(&y)),
            )?;
        // Ticks are sums of decimal fractions: digits beyond the third are noise.
        let number = |v: &f64| {
            let rounded = format!("{v:.2e}").parse().unwrap_or(*v);
            if (0.001..1e5).contains(v) { format!("{rounded}") } else { format!("{rounded:e}") }
        };
        chart
            .configure_mesh()
            .x_desc(&self.axes[0])
            .y_desc(&self.axes[1])
            .x_label_formatter(&number)
            .y_label_formatter(&number)
            .light_line_style(WHITE)
            .draw()?;
        if self.hull {
            // On the axes as drawn, so that the line bends where the eye expects it to.
            let log: Vec<[f64; 2]> = all()
                .map(|p| {
                    let (x, y) = at(p);
                    [x.ln(), y.ln()]
                })
                .collect();
            let hull = lower_hull(&log).into_iter().map(|p| (p[0].exp(), p[1].exp()));
            let style = ShapeStyle { color: BLACK.mix(0.35), filled: false, stroke_width: 4 };
            // Rings: a hull may be a single point.
            chart.draw_series(LineSeries::new(hull, style).point_size(8))?;
            right.draw(&PathElement::new(vec![(4, 40), (20, 40)], style))?;
            right.draw(&Text::new("lower hull", (28, 34), ("sans-serif", 13)))?;
        }
        for (i, series) in self.series.iter().enumerate() {
            let [r, g, b] = COLORS[i % COLORS.len()];
            let color = RGBColor(r, g, b).to_rgba();
            let mut points: Vec<(f64, f64)> = series.points.iter().map(at).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            chart.draw_series(LineSeries::new(points, color.filled().stroke_width(2)).point_size(4))?;
            let y = 60 + 20 * i as i32;
            right.draw(&Circle::new((12, y), 4, color.filled()))?;
            right.draw(&Text::new(series.name.as_str(), (28, y - 6), ("sans-serif", 13)))?;
        }
        root.present()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_lie_in_the_range() {
        assert_eq!(ticks(&(1.2..35.0)), [2.0, 5.0, 10.0, 20.0]);
        assert_eq!(ticks(&(0.5..2e6)), [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6]);
    }

    #[test]
    fn the_hull_bends_downwards_only() {
        let points = [[1.0, 9.0], [2.0, 8.5], [3.0, 2.0], [4.0, 3.0], [5.0, 1.9], [9.0, 1.0], [1.5, 9.5]];
        assert_eq!(lower_hull(&points), [[1.0, 9.0], [3.0, 2.0], [9.0, 1.0]]);
        assert!(lower_hull(&[]).is_empty());
    }
}
