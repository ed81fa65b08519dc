//! The panel beside the picture: what can be set, and what the streamer does.

use egui::{Color32, Grid, RichText, Sense, Slider, SliderClamping, Stroke, Ui, Vec2, pos2};
use umbrage_reader::query::filter::MAX_SIDE;
use umbrage_runtime::stream::FrameStats;

use super::super::{Overlay, Style};
use crate::render::{Filter, Look};

/// What a key or a button asks for; done between frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Action {
    /// Another budget, bytes.
    Budget(u64),
    /// What the index may settle.
    Skip(Option<u32>),
    /// Frames to look ahead.
    Ahead(f64),
    /// Write the picture.
    Picture,
    /// Start or end a recording.
    Record,
    /// Start or end the flight.
    Play,
    /// Back to where it began.
    Home,
}

/// What can be set.
pub(super) struct Controls {
    pub shown: bool,
    pub speed: f64,
    pub budget_mib: f64,
    pub actions: Vec<Action>,
    look: usize,
    side: u32,
    overlay: Option<Overlay>,
    skip: bool,
    error: u32,
    ahead: u32,
}

/// What a frame was like, for people.
pub(super) struct Facts<'a> {
    pub title: &'a str,
    pub device: &'a str,
    pub stats: FrameStats,
    pub budget: u64,
    pub pool: u64,
    pub pages: u32,
    pub loads: u64,
    pub read_bytes: u64,
    pub file_bytes: u64,
    /// Milliseconds between the last frames, and of these the time that this program took.
    pub times: &'a [[f32; 2]],
    pub place: [f64; 3],
    pub message: &'a str,
    pub recording: bool,
    pub playing: bool,
    pub has_flight: bool,
    pub is_vector: bool,
}

const LOOKS: [(&str, &str); 5] = [
    ("hard", "one texel of the finest level"),
    ("continuous", "inside the texel, where that is proven: as sharp as the geometry"),
    ("pcf", "N x N texels of the finest level"),
    ("hpcf", "N x N texels of the level as fine as the pixel"),
    ("trilinear", "N x N texels, blended between the two levels around the pixel's"),
];

impl Controls {
    pub fn new(style: &Style, skips: Option<u32>, budget: u64, speed: f64) -> Self {
        let (look, side) = match style.look {
            Look::Texel => (0, 3),
            Look::Place => (1, 3),
            Look::Filtered(Filter::Pcf(n)) => (2, n),
            Look::Filtered(Filter::Hierarchical(n)) => (3, n),
            Look::Filtered(Filter::Trilinear(n)) => (4, n),
        };
        Self {
            shown: true,
            speed,
            budget_mib: budget as f64 / f64::from(1 << 20),
            actions: Vec::new(),
            look,
            side,
            overlay: style.overlay,
            skip: skips.is_some(),
            error: skips.unwrap_or(0),
            ahead: 12,
        }
    }

    /// What the next frame looks like.
    pub fn style(&self) -> Style {
        let look = match self.look {
            0 => Look::Texel,
            1 => Look::Place,
            2 => Look::Filtered(Filter::Pcf(self.side)),
            3 => Look::Filtered(Filter::Hierarchical(self.side)),
            _ => Look::Filtered(Filter::Trilinear(self.side)),
        };
        Style { look, overlay: self.overlay }
    }

    /// The filter behind this one.
    pub fn next_look(&mut self, is_vector: bool) {
        self.look = (self.look + 1) % LOOKS.len();
        if self.look == 1 && !is_vector {
            self.look = 2;
        }
    }

    /// Another overlay, by number from 1; 0 takes it off, as does the one that is on.
    pub fn set_overlay(&mut self, number: usize) {
        let chosen = number.checked_sub(1).and_then(|i| Overlay::ALL.get(i)).copied();
        self.overlay = chosen.filter(|_| self.overlay != chosen);
    }

    /// Draws the panel and takes what is set there.
    pub fn show(&mut self, ui: &mut Ui, facts: &Facts<'_>) {
        if !self.shown {
            return;
        }
        let window = egui::Window::new("Umbrage").default_pos([8.0, 8.0]).default_width(280.0).resizable(false);
        // A small window scrolls what it has no room for.
        let room = ui.ctx().content_rect().height() - 60.0;
        window.vscroll(true).max_height(room.max(60.0)).show(ui.ctx(), |ui| {
            // Names are never broken.
            ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
            ui.label(RichText::new(facts.title).strong());
            ui.add(egui::Label::new(RichText::new(facts.device).small().weak()).truncate());
            times(ui, facts);
            ui.separator();
            self.lookup(ui, facts);
            ui.separator();
            self.streaming(ui, facts);
            ui.separator();
            figures(ui, facts);
            ui.separator();
            self.buttons(ui, facts);
            if !facts.message.is_empty() {
                ui.add(egui::Label::new(RichText::new(facts.message).color(Color32::from_rgb(255, 190, 90))).wrap());
            }
            let keys = "W A S D, Q E: fly   Shift: faster   drag: look   wheel: speed\n\
                        F: filter   1-5: overlay   P: picture   R: record   Space: flight\n\
                        Home: back   Tab: panel   Esc: close";
            ui.label(RichText::new(keys).small().weak());
        });
    }

    fn lookup(&mut self, ui: &mut Ui, facts: &Facts<'_>) {
        ui.horizontal_wrapped(|ui| {
            for (i, (name, what)) in LOOKS.into_iter().enumerate() {
                ui.add_enabled_ui(i != 1 || facts.is_vector, |ui| {
                    ui.selectable_value(&mut self.look, i, name).on_hover_text(what);
                });
            }
        });
        ui.add_enabled(self.look > 1, Slider::new(&mut self.side, 1..=MAX_SIDE).text("taps on a side"));
        ui.horizontal_wrapped(|ui| {
            ui.selectable_value(&mut self.overlay, None, "picture");
            for overlay in Overlay::ALL {
                ui.selectable_value(&mut self.overlay, Some(overlay), overlay.name());
            }
        });
        if let Some(overlay) = self.overlay {
            ui.add(egui::Label::new(RichText::new(legend(overlay)).small().weak()).wrap());
        }
        ui.add(
            Slider::new(&mut self.speed, 0.01..=10_000.0)
                .clamping(SliderClamping::Edits)
                .logarithmic(true)
                .text("units a second"),
        );
    }

    fn streaming(&mut self, ui: &mut Ui, facts: &Facts<'_>) {
        let least = 0.125f64.min(self.budget_mib);
        let budget = ui.add(
            Slider::new(&mut self.budget_mib, least..=1024.0)
                .clamping(SliderClamping::Edits)
                .logarithmic(true)
                .text("MiB budget"),
        );
        if budget.drag_stopped() || (budget.changed() && !budget.dragged()) {
            self.actions.push(Action::Budget((self.budget_mib * f64::from(1 << 20)) as u64));
        }
        let mut changed = ui.checkbox(&mut self.skip, "skip what the index settles").changed();
        let error = Slider::new(&mut self.error, 0..=u32::MAX - 1).logarithmic(true).text("steps of error");
        changed |= ui.add_enabled(self.skip, error).changed();
        if changed {
            self.actions.push(Action::Skip(self.skip.then_some(self.error)));
        }
        if ui.add(Slider::new(&mut self.ahead, 0..=60).text("frames ahead")).changed() {
            self.actions.push(Action::Ahead(self.ahead.into()));
        }
        let used = facts.stats.resident_bytes as f32 / facts.pool.max(1) as f32;
        let text = format!("{} of {} pool", mib(facts.stats.resident_bytes), mib(facts.pool));
        ui.add(egui::ProgressBar::new(used).text(text));
    }

    fn buttons(&mut self, ui: &mut Ui, facts: &Facts<'_>) {
        ui.horizontal_wrapped(|ui| {
            let mut button = |enabled, text: &str, action| {
                if ui.add_enabled(enabled, egui::Button::new(text)).clicked() {
                    self.actions.push(action);
                }
            };
            button(true, "picture", Action::Picture);
            button(true, if facts.recording { "save recording" } else { "record" }, Action::Record);
            button(facts.has_flight, if facts.playing { "stop flight" } else { "fly" }, Action::Play);
            button(true, "back", Action::Home);
        });
    }
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

fn legend(overlay: Overlay) -> &'static str {
    match overlay {
        Overlay::Residency => "green: exact; blue: exact by the index; yellow to red: by an ancestor",
        Overlay::Level => "a colour for the level of each answer",
        Overlay::Missing => "a colour for each page that is missing",
        Overlay::Pages => "a colour for each page that answers",
        Overlay::Texels => "the texels that answer",
    }
}

/// Milliseconds of the last frames, newest on the right; the darker part is what this program took.
fn times(ui: &mut Ui, facts: &Facts<'_>) {
    let (mut sorted, last) = (facts.times.iter().map(|t| t[0]).collect::<Vec<f32>>(), facts.times.last());
    sorted.sort_by(f32::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let worst = sorted.last().copied().unwrap_or(0.0);
    ui.label(format!("{median:.1} ms a frame (worst {worst:.1}), {:.1} ms of the CPU", last.map_or(0.0, |t| t[1])));
    let (response, painter) = ui.allocate_painter(Vec2::new(ui.available_width().min(264.0), 36.0), Sense::hover());
    let rect = response.rect;
    painter.rect_filled(rect, 2.0, Color32::from_black_alpha(90));
    let scale = rect.height() / worst.max(20.0);
    let step = rect.width() / super::KEPT_TIMES as f32;
    let start = rect.right() - facts.times.len() as f32 * step;
    for (i, [whole, own]) in facts.times.iter().enumerate() {
        let x = start + (i as f32 + 0.5) * step;
        let bar = |height: f32, color| {
            let top = rect.bottom() - (height * scale).min(rect.height());
            painter.line_segment([pos2(x, rect.bottom()), pos2(x, top)], Stroke::new(step.max(1.0), color));
        };
        bar(*whole, Color32::from_rgb(110, 150, 190));
        bar(*own, Color32::from_rgb(40, 90, 150));
    }
}

fn figures(ui: &mut Ui, facts: &Facts<'_>) {
    let s = &facts.stats;
    Grid::new("figures").num_columns(4).spacing([14.0, 2.0]).show(ui, |ui| {
        let pairs = [
            ("resident", s.resident.to_string()),
            ("of", facts.pages.to_string()),
            ("wanted", s.wanted.to_string()),
            ("in flight", s.in_flight.to_string()),
            ("admitted", s.admitted.to_string()),
            ("evicted", s.evicted.to_string()),
            ("starved", s.starved.to_string()),
            ("failing", s.failing.to_string()),
            ("by ancestors", s.by_ancestors.to_string()),
            ("worst levels", s.worst_levels.to_string()),
            ("pages read", facts.loads.to_string()),
            ("uploaded", mib(s.uploaded_bytes)),
            ("bytes read", mib(facts.read_bytes)),
            ("of file", mib(facts.file_bytes)),
        ];
        for row in pairs.chunks(2) {
            for (name, value) in row {
                ui.label(RichText::new(*name).small().weak());
                ui.label(RichText::new(value).small());
            }
            ui.end_row();
        }
    });
    let [x, y, z] = facts.place;
    ui.label(RichText::new(format!("at {x:.2}, {y:.2}, {z:.2}; budget {}", mib(facts.budget))).small().weak());
}
