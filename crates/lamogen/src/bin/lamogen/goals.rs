//! What is asked of a motion, as options and lines of a batch have it.

use std::path::PathBuf;

use lamogen::files::{ReadOptions, read};
use lamogen::{
    COMPONENTS, Component, Device, Goal, Goals, LabanOptions, LabanSeries, PartScale, Scale,
};

use crate::failure::Failure;

/// All that can be asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Asked {
    /// In the order of the components.
    pub goals: [Option<Goal>; COMPONENTS],
    pub scale: Option<Scale>,
    pub like: Option<PathBuf>,
    pub parts: Vec<PartScale>,
}

impl Asked {
    /// The goals together; none if nothing is asked for. Goals of single components replace those of another motion.
    pub fn goals(&self, device: &Device) -> Result<Option<Goals>, Failure> {
        if *self == Asked::default() {
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
