//! The goals of a motion, as a user states them.

use std::path::PathBuf;

use burn::tensor::Device;
use lamogen_files::{ReadError, ReadOptions, read};
use lamogen_laban::{
    COMPONENTS, Component, Goal, Goals, LabanOptions, LabanSeries, PartScale, Scale,
};

/// The goals that a user states in JSON or on a command line: factors, a motion file to be like, parts of the body.
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
    ///
    /// # Errors
    ///
    /// If the motion file cannot be read.
    pub fn resolve(&self, device: &Device) -> Result<Option<Goals>, ReadError> {
        if *self == RequestedGoals::default() {
            return Ok(None);
        }
        let goals = match &self.like {
            Some(path) => {
                let motion = read(path, &ReadOptions::default())?.motion;
                Goals::like(&LabanSeries::of(&motion, &LabanOptions::default(), device))
            }
            None => self.scale.map(Goals::from).unwrap_or_default(),
        };
        Ok(Some(self.combine(goals)))
    }

    /// Combines the goals with the Laban features of a motion that is measured already, in place of those of a file.
    pub fn resolve_like(&self, series: &LabanSeries) -> Goals {
        self.combine(Goals::like(series))
    }

    /// Replaces goals by those of single components, and adds those of parts of the body.
    fn combine(&self, mut goals: Goals) -> Goals {
        for (component, goal) in Component::ALL.into_iter().zip(&self.goals) {
            if let Some(goal) = goal {
                goals = goals.with(component, goal.clone());
            }
        }
        self.parts.iter().cloned().fold(goals, Goals::with_part)
    }
}
