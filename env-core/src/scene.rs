//! Scenes: what an environment looks like, as primitives in the world's own units. Renderers know no world, and worlds know
//! no pixels or colours.

/// One moment of an environment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// Planes shown side by side.
    pub views: Vec<View>,
    /// Lines of text: task, time, remaining resources, score.
    pub status_lines: Vec<String>,
    /// Texts of the events in the last step.
    pub alerts: Vec<String>,
}

/// One plane of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Names of the horizontal and vertical axes; empty if they are obvious.
    pub title: &'static str,
    /// Point at the centre of the view.
    pub center: Point,
    /// Smallest distance from the centre to an edge.
    pub half_extent: f64,
    /// Primitives in drawing order, the last on top.
    pub primitives: Vec<Primitive>,
}

/// A point in a view: horizontal to the right, and vertical upwards.
pub type Point = (f64, f64);

/// Role of a primitive in the scene; the renderer chooses its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Style {
    /// The central body: the Earth, the chief.
    Center,
    /// An agent with this number.
    Agent(u32),
    /// An agent that was lost.
    Lost,
    /// Debris that an agent sees.
    Debris,
    /// Debris that no agent sees.
    HiddenDebris,
    /// The goal of the agents.
    Target,
    /// The action of an agent.
    Burn,
    /// Limits, ranges and predicted paths.
    Guide,
}

/// A primitive to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub enum Primitive {
    /// A filled circle to scale.
    Disc {
        /// Centre of the primitive.
        at: Point,
        /// Radius in the world's unit.
        radius: f64,
        /// Role in the scene.
        style: Style,
    },
    /// The outline of a circle.
    Ring {
        /// Centre of the circle.
        at: Point,
        /// Radius in the world's unit.
        radius: f64,
        /// Role in the scene.
        style: Style,
    },
    /// A line through these points.
    Path {
        /// Points of the line in order.
        points: Vec<Point>,
        /// Role in the scene.
        style: Style,
    },
    /// A moving body with a size that does not depend on the scale. A renderer of successive frames may draw a trail behind
    /// it.
    Marker {
        /// Identity of the body across frames.
        id: u64,
        /// Centre of the primitive.
        at: Point,
        /// Role in the scene.
        style: Style,
    },
    /// An arrow between two points.
    Arrow {
        /// Tail of the arrow.
        from: Point,
        /// Head of the arrow.
        to: Point,
        /// Role in the scene.
        style: Style,
    },
}
