//! The goals of a motion, as the options of the command line and the lines of a batch state them.

use std::path::PathBuf;

use lamogen::files::{ReadOptions, read};
use lamogen::{
    COMPONENTS, Component, Device, Goal, Goals, LabanOptions, LabanSeries, PartScale, Scale,
};

use crate::failure::Failure;

/// The goals that a user states.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RequestedGoals {
    /// The goals of single components, in the order of the components.
    pub goals: [Option<Goal>; COMPONENTS],
    /// Factors on all four components.
    pub scale: Option<Scale>,
    /// A motion file with the Laban features to reach.
    pub like: Option<PathBuf>,
    /// The goals of parts of the body.
    pub parts: Vec<PartScale>,
}

impl RequestedGoals {
    /// Combines the goals, and reads the motion file if there is one. Returns `None` if no goal is stated. Goals of
    /// single components replace those of the motion file.
    pub fn resolve(&self, device: &Device) -> Result<Option<Goals>, Failure> {
        if *self == RequestedGoals::default() {
            return Ok(None);
        }
        let mut goals = match &self.like {
            Some(path) => {
                let motion = read(path, &ReadOptions::default())?.motion;
                Goals::like(&LabanSeries::of(&motion, &LabanOptions::default(), device))
            }
            None => self.scale.map(Goals::from).unwrap_or_default(),
        };
        for (component, goal) in Component::ALL.into_iter().zip(&self.goals) {
            if let Some(goal) = goal {
                goals = goals.with(component, goal.clone());
            }
        }
        Ok(Some(
            self.parts.iter().cloned().fold(goals, Goals::with_part),
        ))
    }
}
