//! How near a motion comes to its places.

use std::fmt;

use lamogen_motion::{JOINTS, Joint};

use super::Places;

/// A place that was asked for, and the position that a motion has there.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PlaceOutcome {
    /// The name of what shall be there: `pelvis` for a place of a path, the name of a [`ReachPart`](super::ReachPart), or `pose`.
    pub name: &'static str,
    /// The moment in seconds.
    pub seconds: f32,
    /// The position that was asked for in metres; y is `None` for a place of a path, which is on the ground, and all
    /// are for a pose, which may be anywhere.
    pub asked: [Option<f32>; 3],
    /// The position of the joint, or of the pelvis of a pose, at that moment in metres.
    pub reached: [f32; 3],
    /// The mean and the largest distance of the joints of a pose from those that were asked for in metres, when both bodies stand and
    /// face alike; `None` for a place.
    pub pose_distances: Option<[f32; 2]>,
}

impl PlaceOutcome {
    /// Returns the distance between the two positions in metres, along the ground if no height was asked for; for a pose the mean
    /// over the joints.
    pub fn distance(&self) -> f32 {
        if let Some([mean, _]) = self.pose_distances {
            return mean;
        }
        let pairs = self.asked.iter().zip(self.reached);
        let squares =
            pairs.filter_map(|(asked, reached)| asked.map(|asked| (reached - asked).powi(2)));
        squares.sum::<f32>().sqrt()
    }
}

impl fmt::Display for PlaceOutcome {
    /// Writes a sentence such as `pelvis at 2 s: asked 1, 0; reached 0.98, 0.01; 2.2 cm off`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some([mean, largest]) = self.pose_distances {
            return write!(
                f,
                "{} at {} s: joints {:.1} cm off on average, {:.1} cm at most",
                self.name,
                self.seconds,
                100.0 * mean,
                100.0 * largest
            );
        }
        let asked: Vec<String> = { self.asked.iter().flatten() }
            .map(|x| format!("{x}"))
            .collect();
        let reached: Vec<String> = { self.asked.iter().zip(self.reached) }
            .filter(|(asked, _)| asked.is_some())
            .map(|(_, x)| format!("{x:.2}"))
            .collect();
        write!(
            f,
            "{} at {} s: asked {}; reached {}; {:.1} cm off",
            self.name,
            self.seconds,
            asked.join(", "),
            reached.join(", "),
            100.0 * self.distance()
        )
    }
}

/// Measures the places of a motion whose poses are joint positions in metres. `frame` is the frame of a moment, if the motion has it.
pub(super) fn outcomes(
    places: &Places,
    poses: &[[[f32; 3]; JOINTS]],
    frame: impl Fn(f32) -> Option<usize>,
) -> Vec<PlaceOutcome> {
    let at = |seconds: f32| frame(seconds).map(|frame| &poses[frame]);
    let waypoints = places.path.iter().flat_map(|path| path.waypoints());
    let path = waypoints.filter_map(|point| {
        Some(PlaceOutcome {
            name: "pelvis",
            seconds: point.seconds,
            asked: [Some(point.place[0]), None, Some(point.place[1])],
            reached: at(point.seconds)?[Joint::Pelvis.index()],
            pose_distances: None,
        })
    });
    let reaches = places.reaches.iter().filter_map(|reach| {
        Some(PlaceOutcome {
            name: reach.part().name(),
            seconds: reach.seconds(),
            asked: reach.position().map(Some),
            reached: at(reach.seconds())?[reach.part().joint().index()],
            pose_distances: None,
        })
    });
    let key_poses = places.poses.iter().filter_map(|key| {
        let pose = at(key.seconds())?;
        let distances = key.distances(pose);
        let mean = distances.iter().sum::<f32>() / JOINTS as f32;
        Some(PlaceOutcome {
            name: "pose",
            seconds: key.seconds(),
            asked: [None; 3],
            reached: pose[Joint::Pelvis.index()],
            pose_distances: Some([mean, distances.into_iter().fold(0.0, f32::max)]),
        })
    });
    path.chain(reaches).chain(key_poses).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::Motion;

    #[test]
    fn distances_are_from_the_joint_at_the_moment() {
        let pose = |t: usize| {
            let mut pose = [[0.0; 3]; JOINTS];
            pose[Joint::Pelvis.index()] = [0.0, 0.9, 0.1 * t as f32];
            pose[Joint::RightWrist.index()] = [0.3, 1.0, 0.1 * t as f32];
            pose
        };
        let motion = Motion::from_joints((0..40).map(pose).collect()).unwrap();
        let places = Places {
            path: Some("1:0.03,1.96".parse().unwrap()),
            reaches: vec!["right-hand@0.5=0.3,1.1,1".parse().unwrap()],
            ..Places::default()
        };
        let outcomes = places.outcomes(&motion);
        let distances: Vec<f32> = outcomes.iter().map(PlaceOutcome::distance).collect();
        assert!((distances[0] - 0.05).abs() < 1e-5, "{distances:?}");
        assert!((distances[1] - 0.1).abs() < 1e-5, "{distances:?}");
        assert_eq!(
            outcomes[0].to_string(),
            "pelvis at 1 s: asked 0.03, 1.96; reached 0.00, 2.00; 5.0 cm off"
        );
    }
}
