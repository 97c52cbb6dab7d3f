//! What an environment looks like, as marks in the world's own units. Whoever draws knows no world; no world knows a pixel.

/// One moment of an environment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// Planes seen side by side.
    pub views: Vec<View>,
    /// Lines of text: the task, the time, what is left, what has been earned.
    pub told: Vec<String>,
    /// What happened in the last step, in words.
    pub alerts: Vec<String>,
}

/// One plane.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// What is across and what is up; empty where that needs no word.
    pub title: &'static str,
    /// What is in the middle.
    pub middle: Point,
    /// From the middle to every edge at least.
    pub reach: f64,
    /// What is drawn, the last on top.
    pub marks: Vec<Mark>,
}

/// A place in a view: across to the right, and up.
pub type Point = (f64, f64);

/// What a mark is drawn as. Colours are the drawer's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Ink {
    /// The body in the middle: the Earth, the chief.
    Centre,
    /// An agent, by its number.
    Agent(u32),
    /// An agent that is lost.
    Lost,
    /// Debris that some agent sees.
    Debris,
    /// Debris that nobody sees.
    Hidden,
    /// Where agents should be.
    Target,
    /// What an agent did.
    Burn,
    /// Limits, ranges, paths.
    Faint,
}

/// Something to draw.
#[derive(Debug, Clone, PartialEq)]
pub enum Mark {
    /// A body of this size.
    Disc {
        /// Where.
        at: Point,
        /// Its radius.
        radius: f64,
        /// As what.
        ink: Ink,
    },
    /// A circle's edge.
    Ring {
        /// Its middle.
        at: Point,
        /// Its radius.
        radius: f64,
        /// As what.
        ink: Ink,
    },
    /// A line through these points.
    Path {
        /// In order.
        points: Vec<Point>,
        /// As what.
        ink: Ink,
    },
    /// What somebody flies along, of a size that does not depend on the scale; who draws frame after frame may leave a trail
    /// behind it.
    Craft {
        /// The same from frame to frame.
        id: u64,
        /// Where.
        at: Point,
        /// As what.
        ink: Ink,
    },
    /// An arrow.
    Arrow {
        /// Its tail.
        from: Point,
        /// Its head.
        to: Point,
        /// As what.
        ink: Ink,
    },
}
