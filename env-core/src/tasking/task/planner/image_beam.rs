//! Beam search over the next actions of an imager, by the models of time and energy.
//!
//! States are kept in slots of time: those of a slot end an action at about the same time, so that their values compare.

use super::image_sky::ImageSky;
use super::light::panel_cosine;
use super::slew_time::SlewTime;
use crate::tasking::task::spaces::IMAGE_ACTIONS;
use crate::tasking::vector3::{Vector3, dot, scale};

/// Length of a slot of time, s.
const SLOT_S: f64 = 10.0;
/// Largest number of images on a path.
const MAX_IMAGES: usize = 24;
/// Largest number of states in a slot that begin with the same action.
const SAME_FIRST: usize = 2;
/// Share by which the rate of value follows that of the last search.
const ADAPTATION: f64 = 0.1;
/// Time from a window's opening to its image, s.
const OPENING_S: f64 = 3.0;
/// Duration of charging, s.
const CHARGE_S: f64 = 120.0;
/// Duration of a downlink, s.
const DOWNLINK_S: f64 = 60.0;
/// Time in which the panel turns to the Sun, s.
const SUN_SLEW_S: f64 = 50.0;
/// Least time of access for which a downlink is worth it, s.
const MIN_ACCESS_S: f64 = 20.0;
/// Stored data from which downlinks are tried, as a share of the storage.
const DOWNLINK_FROM: f64 = 0.6;
/// Power of an imager with all its slews, W, for the energy that it can still use.
const USE_W: f64 = 35.0;
/// Value of the energy that a satellite needs to survive the dark, in seconds of its best rate of value for each joule.
const SURVIVAL_S_PER_J: f64 = 0.5;

/// Worth of time and energy in a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Worth {
    /// Value that is earned in a second of imaging. Searches adapt it to what they find.
    pub(super) rate: f64,
    /// Power whose value equals that of imaging, W: the smaller, the more energy is worth.
    pub(super) power_w: f64,
}

/// Effort of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Effort {
    /// States that are kept in a slot of time.
    pub(super) width: usize,
    /// Number of slots of time.
    pub(super) slots: usize,
}

/// State of an imager between two actions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ImagerState {
    /// Time since the start, s.
    pub(super) time_s: f64,
    /// Planet-fixed direction of the instrument.
    pub(super) boresight: Vector3<f64>,
    /// Charge of the battery, J.
    pub(super) battery_ws: f64,
    /// Data in the storage, bits.
    pub(super) stored_bits: f64,
}

/// Which targets a satellite lists and what their images are worth.
#[derive(Debug, Clone)]
pub(super) struct TargetBook {
    /// Time from which the satellite knows the image of a target, s.
    pub(super) known_from_s: Vec<f64>,
    /// True for targets that another satellite images.
    pub(super) is_claimed: Vec<bool>,
}

impl TargetBook {
    pub(super) fn new(targets: usize) -> Self {
        Self { known_from_s: vec![f64::INFINITY; targets], is_claimed: vec![false; targets] }
    }
}

/// A first action with the best path that begins with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FirstAction {
    /// Index of the action.
    pub(super) action: usize,
    /// Value of the best path.
    pub(super) value: f64,
    /// Value of the first action by itself.
    pub(super) earned: f64,
    /// State after the first action.
    pub(super) after: ImagerState,
    /// Value earned on the best path, and its duration, s.
    pub(super) path: [f64; 2],
}

#[derive(Debug, Clone, Copy)]
struct Node {
    state: ImagerState,
    earned: f64,
    /// Earned value and the value of the energy.
    key: f64,
    first: usize,
    images: usize,
    targets: [u32; MAX_IMAGES],
}

/// Memory and settings of searches.
#[derive(Debug, Clone)]
pub(super) struct Beam {
    pub(super) effort: Effort,
    pub(super) worth: Worth,
    /// Momentum of the wheels, N·m·s.
    pub(super) momentum: f64,
    /// Charge that a satellite keeps beside what it needs in the dark, as a share of the battery.
    pub(super) reserve: f64,
    slots: Vec<Vec<Node>>,
    firsts: Vec<FirstAction>,
    children: Vec<Child>,
}

/// An action from a state.
#[derive(Debug, Clone, Copy)]
struct Child {
    action: usize,
    target: Option<usize>,
    earned: f64,
    state: ImagerState,
}

impl Beam {
    pub(super) const fn new(effort: Effort, worth: Worth, reserve: f64) -> Self {
        Self {
            effort,
            worth,
            momentum: 0.0,
            reserve,
            slots: Vec::new(),
            firsts: Vec::new(),
            children: Vec::new(),
        }
    }

    /// The first actions from a state, best first; equal ones in order.
    pub(super) fn search(&mut self, sky: &ImageSky, book: &TargetBook, start: ImagerState) -> &[FirstAction] {
        let end_s = (start.time_s + self.effort.slots as f64 * SLOT_S).min(sky.limit_s);
        self.slots.resize(self.effort.slots + 1, Vec::new());
        self.slots.iter_mut().for_each(Vec::clear);
        self.firsts.clear();
        let root = Node {
            state: start,
            earned: 0.0,
            key: 0.0,
            first: usize::MAX,
            images: 0,
            targets: [0; MAX_IMAGES],
        };
        self.expand(sky, book, &root, start.time_s, end_s);
        for slot in 0..self.effort.slots {
            let nodes = std::mem::take(&mut self.slots[slot]);
            for node in &nodes {
                self.expand(sky, book, node, start.time_s, end_s);
            }
            self.slots[slot] = nodes;
        }
        self.firsts.sort_by(|a, b| b.value.total_cmp(&a.value));
        if let Some(best) = self.firsts.first()
            && best.path[0] > 0.0
        {
            let found = best.path[0] / best.path[1].max(1.0);
            self.worth.rate += ADAPTATION * (found - self.worth.rate);
        }
        &self.firsts
    }

    fn expand(&mut self, sky: &ImageSky, book: &TargetBook, node: &Node, start_s: f64, end_s: f64) {
        let mut children = std::mem::take(&mut self.children);
        children.clear();
        self.add_children(sky, book, node, &mut children);
        for child in &children {
            let mut next = *node;
            next.state = child.state;
            next.earned += child.earned;
            if let Some(target) = child.target
                && next.images < MAX_IMAGES
            {
                next.targets[next.images] = target as u32;
                next.images += 1;
            }
            next.key = next.earned + self.energy_value(sky, &next.state);
            if next.first == usize::MAX {
                next.first = self.firsts.len();
                self.firsts.push(FirstAction {
                    action: child.action,
                    value: f64::NEG_INFINITY,
                    earned: child.earned,
                    after: child.state,
                    path: [0.0; 2],
                });
            }
            let time_s = next.state.time_s;
            let value = next.key - self.worth.rate * (time_s - end_s);
            let first = &mut self.firsts[next.first];
            // A path that has not reached the end yet earns what it is worth to be early at the usual rate.
            let is_final = time_s >= end_s;
            if (is_final || first.value == f64::NEG_INFINITY) && value > first.value {
                first.value = value;
                first.path = [next.earned, time_s - start_s];
            }
            if !is_final {
                self.keep(&next, start_s);
            }
        }
        self.children = children;
    }

    /// Keeps a node if it is among the best of its slot.
    fn keep(&mut self, node: &Node, start_s: f64) {
        let index = ((node.state.time_s - start_s) / SLOT_S) as usize;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let is_same = |other: &Node| other.first == node.first;
        let is_crowded = slot.iter().filter(|other| is_same(other)).count() >= SAME_FIRST;
        if slot.len() < self.effort.width && !is_crowded {
            slot.push(*node);
            return;
        }
        let rivals = slot.iter_mut().filter(|other| !is_crowded || is_same(other));
        let worst = rivals.min_by(|a, b| a.key.total_cmp(&b.key));
        if let Some(worst) = worst.filter(|worst| node.key > worst.key) {
            *worst = *node;
        }
    }

    /// Value of the energy in the battery.
    pub(super) fn energy_value(&self, sky: &ImageSky, state: &ImagerState) -> f64 {
        let usable = ((sky.limit_s - state.time_s).max(0.0) * USE_W).min(sky.args.battery_capacity_ws);
        let dark_s = sky.light(state.time_s).dark_s;
        let needed =
            (self.reserve * sky.args.battery_capacity_ws + dark_s * sky.args.base_load_w()).min(usable);
        let used = state.battery_ws.min(usable);
        // The less is left, the more a joule is worth.
        self.worth.rate / self.worth.power_w * used * (2.0 - used / usable.max(1.0))
            + self.worth.rate * SURVIVAL_S_PER_J * state.battery_ws.min(needed)
    }

    fn add_children(&self, sky: &ImageSky, book: &TargetBook, node: &Node, children: &mut Vec<Child>) {
        let start = &node.state;
        let first = sky.windows.partition_point(|window| window.close_s < start.time_s + 1e-12);
        let is_full = start.stored_bits + sky.args.instrument_bits > sky.args.storage_capacity_bits;
        let mut listed = 0;
        for window in &sky.windows[first..] {
            let target = window.target;
            if book.known_from_s[target] <= start.time_s
                || node.targets[..node.images].contains(&(target as u32))
            {
                continue;
            }
            let action = listed;
            listed += 1;
            if !(book.is_claimed[target] || is_full) {
                let opening_s = window.open_s.ceil() + OPENING_S;
                let end_s = self.image_time(sky, start, &window.position, opening_s);
                if end_s < window.close_s && end_s <= sky.limit_s {
                    let heading = sky.heading(&window.position, end_s);
                    let mut state = self.after_image(sky, start, heading, end_s);
                    state.stored_bits += sky.args.instrument_bits;
                    children.push(Child { action, target: Some(target), earned: window.priority, state });
                }
            }
            if listed == IMAGE_ACTIONS {
                break;
            }
        }
        children.push(self.charge(sky, start));
        if let Some(child) = self.downlink(sky, start) {
            children.push(child);
        }
    }

    /// Time of the image of a position whose window opens at a time, s.
    fn image_time(
        &self,
        sky: &ImageSky,
        start: &ImagerState,
        position: &Vector3<f64>,
        opening_s: f64,
    ) -> f64 {
        let mut end_s = (start.time_s + sky.slew_time.seconds(30.0)).max(opening_s);
        for _ in 0..2 {
            let angle = angle_deg(&start.boresight, &sky.heading(position, end_s));
            end_s = (start.time_s + sky.slew_time.seconds(angle)).max(opening_s);
        }
        end_s
    }

    /// State after an image, without its data.
    fn after_image(
        &self,
        sky: &ImageSky,
        start: &ImagerState,
        heading: Vector3<f64>,
        end_s: f64,
    ) -> ImagerState {
        let duration_s = end_s - start.time_s;
        let light = sky.light(0.5 * (start.time_s + end_s));
        let cosine = 0.5 * (panel_cosine(&start.boresight, &light.sun) + panel_cosine(&heading, &light.sun));
        let slew_ws = SlewTime::energy_ws(angle_deg(&start.boresight, &heading), self.momentum);
        let power = light.panel_w * cosine - sky.args.base_load_w() + sky.args.instrument_power_w;
        self.moved(sky, start, heading, end_s, power * duration_s - slew_ws)
    }

    fn moved(
        &self,
        sky: &ImageSky,
        start: &ImagerState,
        boresight: Vector3<f64>,
        time_s: f64,
        energy_ws: f64,
    ) -> ImagerState {
        let battery_ws = (start.battery_ws + energy_ws).clamp(0.0, sky.args.battery_capacity_ws);
        ImagerState { time_s, boresight, battery_ws, ..*start }
    }

    fn charge(&self, sky: &ImageSky, start: &ImagerState) -> Child {
        let end_s = (start.time_s + CHARGE_S).min(sky.limit_s.max(start.time_s + 1.0));
        let light = sky.light(0.5 * (start.time_s + end_s));
        let before = panel_cosine(&start.boresight, &light.sun);
        let slew_s = if before > 0.999 { 0.0 } else { SUN_SLEW_S };
        let lit_s = end_s - start.time_s - 0.5 * slew_s * (1.0 - before);
        let heading = scale(&light.sun, -1.0);
        let slew_ws = SlewTime::energy_ws(angle_deg(&start.boresight, &heading), self.momentum);
        let energy =
            light.panel_w * lit_s.max(0.0) - sky.args.base_load_w() * (end_s - start.time_s) - slew_ws;
        let state = self.moved(sky, start, heading, end_s, energy);
        Child { action: IMAGE_ACTIONS, target: None, earned: 0.0, state }
    }

    fn downlink(&self, sky: &ImageSky, start: &ImagerState) -> Option<Child> {
        if start.stored_bits < DOWNLINK_FROM * sky.args.storage_capacity_bits {
            return None;
        }
        let end_s = start.time_s + DOWNLINK_S;
        let access = |pass: &[f64; 2]| pass[1].min(end_s) - pass[0].max(start.time_s);
        let access_s = sky.passes.iter().map(access).fold(0.0, f64::max);
        if access_s < MIN_ACCESS_S || end_s > sky.limit_s {
            return None;
        }
        let power = sky.args.transmitter_power_w - sky.args.base_load_w();
        let slew_ws = SlewTime::energy_ws(90.0, self.momentum);
        let mut state = self.moved(sky, start, start.boresight, end_s, power * DOWNLINK_S - slew_ws);
        state.stored_bits = (state.stored_bits + access_s * sky.args.transmitter_baud).max(0.0);
        Some(Child { action: IMAGE_ACTIONS + 1, target: None, earned: 0.0, state })
    }
}

/// Angle between two directions, degrees, with an error below 0.004° (Abramowitz and Stegun 1964, eq. 4.4.45).
fn angle_deg(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let cosine = dot(a, b).clamp(-1.0, 1.0);
    let x = cosine.abs();
    let series = 1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261 - x * 0.018_729_3));
    let acute = ((1.0 - x).sqrt() * series).to_degrees();
    if cosine < 0.0 { 180.0 - acute } else { acute }
}
