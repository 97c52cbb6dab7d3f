//! What a run is told about designs.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::designs::DesignerKind;
use crate::engine::error::ServiceError;
use crate::runs::settings::within;

/// Who designs for a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesignerChoice {
    /// The language model where the server has one, else the procedural designer.
    Auto,
    /// The language model; the procedural designer does what it does not.
    Llm,
    /// The procedural designer.
    Procedural,
    /// Nobody: nothing is designed.
    Off,
}

impl DesignerChoice {
    /// The kind that is asked; none where nothing is designed.
    #[must_use]
    pub const fn which(self, has_llm: bool) -> Option<DesignerKind> {
        match (self, has_llm) {
            (Self::Off, _) => None,
            (Self::Llm, _) | (Self::Auto, true) => Some(DesignerKind::Llm),
            (Self::Procedural, _) | (Self::Auto, false) => Some(DesignerKind::Procedural),
        }
    }
}

/// Layouts designed for the agent's failures, as a run asks for them. Everything may be left out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DesignSettingsRequest {
    /// The share of training groups that are designed, 0 to 1 (0.3), once there are failures to design for and the task's
    /// placement is over. 0: nothing is designed.
    pub share: Option<f64>,
    /// Who designs: `auto` (default), `llm`, `procedural` or `off`.
    pub designer: Option<DesignerChoice>,
    /// The share of training groups that one layout may take, above 0, at most 1 (0.05); four groups it may always take.
    pub layout_share: Option<f64>,
    /// Whether outcomes of designed groups move levels and mastery (false). Then those of threats that were designed at the
    /// current level do.
    pub evidence: Option<bool>,
    /// How many active layouts near the current level of a task are kept in stock: 1 to 64 (8).
    pub stock: Option<u32>,
}

/// The same, complete, as stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DesignSettings {
    /// The share of training groups that are designed.
    pub share: f64,
    /// Who designs.
    pub designer: DesignerChoice,
    /// The share of training groups that one layout may take.
    pub layout_share: f64,
    /// Whether outcomes of designed groups are evidence.
    pub evidence: bool,
    /// How many active layouts near the current level are kept in stock.
    pub stock: u32,
}

/// A run of before there were designs: it goes on as it was.
impl Default for DesignSettings {
    fn default() -> Self {
        Self { share: 0.0, designer: DesignerChoice::Off, layout_share: 0.05, evidence: false, stock: 8 }
    }
}

impl DesignSettings {
    /// Checks a wish and fills it up.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(wish: &DesignSettingsRequest) -> Result<Self, ServiceError> {
        let share = wish.share.unwrap_or(0.3);
        if !(0.0..=1.0).contains(&share) {
            return Err(ServiceError::invalid("design.share", format!("it is {share}, outside 0 to 1")));
        }
        let layout_share = wish.layout_share.unwrap_or(0.05);
        if !(layout_share > 0.0 && layout_share <= 1.0) {
            let words = format!("it is {layout_share}, but must be above 0 and at most 1");
            return Err(ServiceError::invalid("design.layout_share", words));
        }
        let stock = wish.stock.unwrap_or(8);
        within("design.stock", stock, 1, 64)?;
        Ok(Self {
            share,
            designer: wish.designer.unwrap_or(DesignerChoice::Auto),
            layout_share,
            evidence: wish.evidence.unwrap_or(false),
            stock,
        })
    }

    /// Whether anything is designed and served.
    #[must_use]
    pub fn on(&self) -> bool {
        self.share > 0.0 && self.designer != DesignerChoice::Off
    }
}
