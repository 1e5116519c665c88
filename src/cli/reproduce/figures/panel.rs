//! Axes and curves.

use super::svg::{Anchor, Stroke, Svg};

const GRID: Stroke = Stroke { color: "#e4e4e4", width: 1.0, dash: "" };
const FRAME: Stroke = Stroke { color: "#888", width: 1.0, dash: "" };
const INK: &str = "#333";
/// Labelled ticks that an axis has at most.
const MOST_TICKS: f64 = 6.0;

/// From numbers to a share of a panel's side.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    /// From tick to tick; none on a logarithmic axis.
    step: Option<f64>,
    label: String,
}

impl Axis {
    /// From the least to the greatest of these.
    pub(super) fn linear(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        Self::stepped(label, range(values), 0.0)
    }

    /// Likewise with ticks at whole numbers alone.
    pub(super) fn whole(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        Self::stepped(label, range(values), 1.0)
    }

    fn stepped(label: &str, (low, high): (f64, f64), least_step: f64) -> Self {
        let step = step(high - low).max(least_step);
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        Self { low, high: if high > low { high } else { low + step }, step: Some(step), label: label.to_owned() }
    }

    /// The same from 0 on.
    pub(super) fn from_zero(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        Self::linear(label, values.into_iter().chain([0.0]))
    }

    /// Logarithmic, for numbers above 0.
    pub(super) fn logarithmic(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = range(values.into_iter().filter(|&x| x > 0.0));
        let (low, high) = if low > 0.0 { (low / 1.1, high * 1.1) } else { (0.1, 10.0) };
        Self { low, high, step: None, label: label.to_owned() }
    }

    fn share(&self, value: f64) -> f64 {
        let scale = |x: f64| if self.step.is_none() { x.max(self.low).log10() } else { x };
        (scale(value) - scale(self.low)) / (scale(self.high) - scale(self.low))
    }

    fn ticks(&self) -> Vec<(f64, String)> {
        if let Some(step) = self.step {
            let count = ((self.high - self.low) / step).round() as usize;
            let digits = (-step.log10().floor()).max(0.0) as usize;
            let at = |k: usize| self.low + k as f64 * step;
            return (0..=count).map(|k| (at(k), format!("{:.digits$}", at(k) + 0.0))).collect();
        }
        let decades = self.high.log10() - self.low.log10();
        let factors: &[f64] = if decades < 1.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let every = (decades / MOST_TICKS).ceil().max(1.0) as i32;
        let first = self.low.log10().floor() as i32;
        let powers = (first..=self.high.log10().ceil() as i32).filter(|power| power.rem_euclid(every) == 0);
        let ticks = powers.flat_map(|power| factors.iter().map(move |factor| factor * 10_f64.powi(power)));
        ticks.filter(|tick| (self.low..=self.high).contains(tick)).map(|tick| (tick, plain(tick))).collect()
    }
}

fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let finite = values.into_iter().filter(|x| x.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}

/// 1, 2 or 5 times a power of ten, so that an axis has few ticks.
fn step(length: f64) -> f64 {
    // One number alone has an axis too.
    let raw = if length > 0.0 { length / MOST_TICKS } else { 1.0 };
    let power = 10_f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * power).find(|&step| step >= raw).unwrap_or(10.0 * power)
}

fn plain(value: f64) -> String {
    if (1e-3..1e4).contains(&value) { format!("{value}") } else { format!("{value:e}") }
}

/// A frame with axes, and what is drawn in it.
pub(super) struct Panel {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) x: Axis,
    pub(super) y: Axis,
}

impl Panel {
    /// Grid, frame, ticks, labels and title.
    pub(super) fn frame(&self, svg: &mut Svg, title: &str) {
        let (right, bottom) = (self.left + self.width, self.top + self.height);
        for (value, text) in self.x.ticks() {
            let x = self.left + self.width * self.x.share(value);
            svg.polyline(&[(x, self.top), (x, bottom)], GRID);
            svg.text((x, bottom + 15.0), 11.0, Anchor::Middle, INK, &text);
        }
        for (value, text) in self.y.ticks() {
            let y = bottom - self.height * self.y.share(value);
            svg.polyline(&[(self.left, y), (right, y)], GRID);
            svg.text((self.left - 6.0, y + 4.0), 11.0, Anchor::End, INK, &text);
        }
        let corners =
            [(self.left, self.top), (right, self.top), (right, bottom), (self.left, bottom), (self.left, self.top)];
        svg.polyline(&corners, FRAME);
        svg.text((self.left + self.width / 2.0, bottom + 33.0), 12.0, Anchor::Middle, INK, &self.x.label);
        svg.upright((self.left - 42.0, self.top + self.height / 2.0), 12.0, &self.y.label);
        svg.text((self.left, self.top - 8.0), 13.0, Anchor::Start, "#111", title);
    }

    /// Where a point of the axes is in the picture.
    pub(super) fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let inside = |share: f64| share.clamp(0.0, 1.0);
        (self.left + self.width * inside(self.x.share(x)), self.top + self.height * (1.0 - inside(self.y.share(y))))
    }

    pub(super) fn curve(&self, svg: &mut Svg, points: &[(f64, f64)], stroke: Stroke) {
        svg.polyline(&points.iter().map(|&point| self.at(point)).collect::<Vec<_>>(), stroke);
    }
}

/// Names and their lines, from left to right.
pub(super) fn legend(svg: &mut Svg, (mut x, y): (f64, f64), entries: &[(String, Stroke)]) {
    for (name, stroke) in entries {
        svg.polyline(&[(x, y - 4.0), (x + 26.0, y - 4.0)], *stroke);
        svg.text((x + 32.0, y), 12.0, Anchor::Start, INK, name);
        x += 50.0 + 7.0 * name.chars().count() as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<String> {
        axis.ticks().into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_numbers_around_the_data() {
        assert_eq!(labels(&Axis::linear("", [3.2, 17.9])), ["0", "5", "10", "15", "20"]);
        assert_eq!(labels(&Axis::from_zero("", [0.23])), ["0.00", "0.05", "0.10", "0.15", "0.20", "0.25"]);
        assert_eq!(labels(&Axis::logarithmic("", [0.5, 2e4])), ["1", "10", "100", "1000", "1e4"]);
        assert_eq!(labels(&Axis::logarithmic("", [9.0, 30.0])), ["10", "20"]);
        assert_eq!(labels(&Axis::linear("", [11.7, 22.3])), ["10", "12", "14", "16", "18", "20", "22", "24"]);
        assert_eq!(labels(&Axis::whole("", [1.0, 3.0])), ["1", "2", "3"]);
        assert_eq!(labels(&Axis::linear("", [4.0])).len(), 2, "one number has an axis too");
        assert_eq!(labels(&Axis::linear("", [f64::NAN])).first().map(String::as_str), Some("0.0"));
    }

    #[test]
    fn points_lie_where_the_axes_say_and_stay_inside() {
        let (x, y) = (Axis::linear("", [0.0, 10.0]), Axis::logarithmic("", [1.0, 100.0]));
        let panel = Panel { left: 50.0, top: 20.0, width: 200.0, height: 100.0, x, y };
        let (px, py) = panel.at((5.0, 10.0));
        assert!((px - 150.0).abs() < 1e-9 && (py - 70.0).abs() < 1e-9, "{px} {py}");
        assert_eq!(panel.at((99.0, 1e9)), (250.0, 20.0));
    }
}
