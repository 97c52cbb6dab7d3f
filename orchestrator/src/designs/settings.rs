//! Settings of a run that concern designed layouts.

use api_types::{DesignSettingsRequest, DesignerChoice};
use env_core::format_shortest;
use serde::{Deserialize, Serialize};

use store::learning_signals::LearningSignalSums;

use crate::designs::DesignerKind;
use crate::designs::learning_value::designed_share;
use crate::engine::error::ServiceError;
use crate::runs::validate::check_range;

/// Returns the designer to use; `None` if nothing is designed.
#[must_use]
pub const fn designer_kind(choice: DesignerChoice, has_llm: bool) -> Option<DesignerKind> {
    match (choice, has_llm) {
        (DesignerChoice::Off, _) => None,
        (DesignerChoice::Llm, _) | (DesignerChoice::Auto, true) => Some(DesignerKind::Llm),
        (DesignerChoice::Procedural, _) | (DesignerChoice::Auto, false) => Some(DesignerKind::Procedural),
    }
}

/// Design settings of a run, complete, as stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DesignSettings {
    /// The largest share of training groups that are designed, 0 to 1.
    pub share: f64,
    /// True if the share is always the largest; false if it follows what the agent learns from designed groups.
    #[serde(default)]
    pub fixed_share: bool,
    /// The designer of the run.
    pub designer: DesignerChoice,
    /// The share of training groups that one layout may take, above 0 and at most 1.
    pub layout_share: f64,
    /// Number of active layouts near the current level that are kept in reserve, for each task.
    pub reserve: u32,
}

/// The settings of a run that was stored without design settings: nothing is designed.
impl Default for DesignSettings {
    fn default() -> Self {
        Self { share: 0.0, fixed_share: false, designer: DesignerChoice::Off, layout_share: 0.05, reserve: 8 }
    }
}

impl DesignSettings {
    /// Checks a request and returns complete settings.
    ///
    /// # Errors
    /// Returns an error that names the first field that is out of bounds.
    pub fn from_request(request: &DesignSettingsRequest) -> Result<Self, ServiceError> {
        let share = request.share.unwrap_or(0.3);
        if !(0.0..=1.0).contains(&share) {
            return Err(ServiceError::invalid(
                "design.share",
                format!("must be from 0 to 1, got {}", format_shortest(share)),
            ));
        }
        let layout_share = request.layout_share.unwrap_or(0.05);
        if !(layout_share > 0.0 && layout_share <= 1.0) {
            let reason = format!("must be above 0 and at most 1, got {}", format_shortest(layout_share));
            return Err(ServiceError::invalid("design.layout_share", reason));
        }
        let reserve = request.reserve.unwrap_or(8);
        check_range("design.reserve", reserve, 1, 64)?;
        Ok(Self {
            share,
            fixed_share: request.fixed_share.unwrap_or(false),
            designer: request.designer.unwrap_or(DesignerChoice::Auto),
            layout_share,
            reserve,
        })
    }

    /// Returns the share of training groups that are designed now, 0 to `share`.
    #[must_use]
    pub fn current_share(&self, signals: &LearningSignalSums) -> f64 {
        match (self.is_enabled(), self.fixed_share) {
            (false, _) => 0.0,
            (true, true) => self.share,
            (true, false) => designed_share(signals, self.share),
        }
    }

    /// Returns true if layouts are designed and served.
    #[must_use]
    pub fn is_enabled(&self) -> bool {
        self.share > 0.0 && self.designer != DesignerChoice::Off
    }
}
