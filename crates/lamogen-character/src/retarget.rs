//! Rotations of a motion, carried over to the skeleton of a character.

use glam::{DQuat, DVec3};
use lamogen_body::ground;
use lamogen_motion::{
    FRAMES_PER_SECOND, JOINTS, Joint, Motion, Rotations, ground_path, loop_frame_rate,
};

use crate::skeleton::CharacterSkeleton;
use crate::{arms, legs};

/// Options of retargeting.
#[derive(Clone, Debug, PartialEq)]
pub struct RetargetOptions {
    /// Keyframes per second. The default is 30.
    pub frames_per_second: f32,
    /// Whether feet that stand in the motion are held in their place on the character, by bending its legs. The default
    /// is true.
    pub plant_feet: bool,
    /// Whether hands that touch each other or the body in the motion do so on the character, by bending its arms. The default is
    /// true.
    pub place_hands: bool,
    /// Whether straight fingers are bent as those of a relaxed hand. The default is true.
    pub relax_hands: bool,
}

impl Default for RetargetOptions {
    fn default() -> Self {
        RetargetOptions {
            frames_per_second: 30.0,
            plant_feet: true,
            place_hands: true,
            relax_hands: true,
        }
    }
}

/// The poses of a character's nodes in the world at one frame.
#[derive(Clone, Debug)]
pub(crate) struct CharacterPose {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) rotations: Vec<DQuat>,
}

/// A bone of a limb: the joint that turns it, and the joint at its end.
const LIMB_BONES: [(Joint, Joint); 8] = [
    (Joint::LeftHip, Joint::LeftKnee),
    (Joint::LeftKnee, Joint::LeftAnkle),
    (Joint::RightHip, Joint::RightKnee),
    (Joint::RightKnee, Joint::RightAnkle),
    (Joint::LeftShoulder, Joint::LeftElbow),
    (Joint::LeftElbow, Joint::LeftWrist),
    (Joint::RightShoulder, Joint::RightElbow),
    (Joint::RightElbow, Joint::RightWrist),
];

/// A node that the motion turns.
#[derive(Clone, Copy, Debug)]
struct DrivenNode {
    place: usize,
    /// The rotation that brings the bone from the character's rest pose to that of the motion's body, in the world.
    alignment: DQuat,
    source: RotationSource,
}

/// The part of the motion's body that turns a node.
#[derive(Clone, Copy, Debug)]
enum RotationSource {
    Joint(Joint),
    /// A place on the line of pelvis (0), the three joints of the spine, and the neck (4).
    Spine(f64),
}

/// The joints of the line on which the spine of a character is placed.
const SPINE: [Joint; 5] = [
    Joint::Pelvis,
    Joint::Spine1,
    Joint::Spine2,
    Joint::Spine3,
    Joint::Neck,
];

/// A motion on a character, frame by frame.
pub(crate) struct RetargetedMotion<'a> {
    pub(crate) retargeter: Retargeter<'a>,
    /// The poses. Those of a loop end with the frame that closes it.
    pub(crate) poses: Vec<CharacterPose>,
    pub(crate) frames_per_second: f32,
    /// The travel of a loop in a cycle along the ground, `[x, z]` in the character's world.
    loop_travel: Option<[f32; 2]>,
}

impl RetargetedMotion<'_> {
    /// Returns the path of a node along the ground.
    pub(crate) fn ground_path(&self, place: usize) -> Vec<DVec3> {
        let positions = self.poses.iter().map(|pose| pose.positions[place]);
        let positions: Vec<[f32; 3]> = positions.map(|at| at.as_vec3().to_array()).collect();
        ground_path(&positions, self.frames_per_second, self.loop_travel)
            .into_iter()
            .map(|[x, z]| DVec3::new(f64::from(x), 0.0, f64::from(z)))
            .collect()
    }
}

/// Puts a motion on a skeleton.
pub(crate) fn retarget<'a>(
    skeleton: &'a CharacterSkeleton,
    motion: &Motion,
    options: &RetargetOptions,
) -> RetargetedMotion<'a> {
    let Some(repeated) = motion.repeated(3) else {
        let retargeter = Retargeter::new(skeleton, motion, options.frames_per_second);
        return RetargetedMotion {
            poses: retargeter.poses(motion, options),
            retargeter,
            frames_per_second: options.frames_per_second,
            loop_travel: None,
        };
    };
    // A loop is retargeted with a cycle before it and one after it, so that feet that stand across the seam keep their places.
    let frames_per_second = loop_frame_rate(motion.frames(), options.frames_per_second);
    let retargeter = Retargeter::new(skeleton, &repeated, frames_per_second);
    let seconds = motion.frames() as f32 / FRAMES_PER_SECOND;
    let frames = (seconds * frames_per_second).round() as usize;
    let [x, z] = motion.loop_travel().unwrap_or_default().map(f64::from);
    let travel = skeleton.facing * (DVec3::new(x, 0.0, z) * retargeter.ratio);
    let mut poses = retargeter.poses(&repeated, options);
    poses.truncate(2 * frames + 1);
    poses.drain(..frames);
    // The second cycle is moved back to where the first one was. Nodes above the body do not move.
    for pose in &mut poses {
        for place in 0..skeleton.nodes.len() {
            if skeleton
                .ancestors(place)
                .any(|above| above == skeleton.carrier)
            {
                pose.positions[place] -= travel;
            }
        }
    }
    RetargetedMotion {
        retargeter,
        poses,
        frames_per_second,
        loop_travel: Some([travel.x as f32, travel.z as f32]),
    }
}

/// A motion on a character: what turns which node, and how large steps are.
pub(crate) struct Retargeter<'a> {
    pub(crate) skeleton: &'a CharacterSkeleton,
    pub(crate) rotations: Rotations,
    driven: Vec<DrivenNode>,
    /// The length of the character's legs in units of those of the motion's body.
    pub(crate) ratio: f64,
    /// The height of the ground under the motion, in metres.
    pub(crate) ground: f64,
    /// The positions of the joints of the motion's body in its rest pose.
    pub(crate) source_rest: [DVec3; JOINTS],
    /// The height of the character's pelvis when the motion's body stands in its rest pose.
    standing_height: f64,
}

impl<'a> Retargeter<'a> {
    pub(crate) fn new(
        skeleton: &'a CharacterSkeleton,
        motion: &Motion,
        frames_per_second: f32,
    ) -> Self {
        let rotations = motion.rotations().resampled(frames_per_second);
        let rest = rotations.rest();
        let mut source_rest = [DVec3::ZERO; JOINTS];
        for joint in Joint::ALL {
            let parent = joint
                .parent()
                .map_or(DVec3::ZERO, |parent| source_rest[parent.index()]);
            let offset = rest.offset(joint).map(f64::from);
            source_rest[joint.index()] = parent + DVec3::from(offset);
        }
        let source_leg = f64::from(rotations.rest().leg());
        let mut retargeter = Retargeter {
            ratio: skeleton.leg_length() / source_leg,
            ground: ground(motion),
            driven: driven_nodes(skeleton, &source_rest),
            skeleton,
            rotations,
            source_rest,
            standing_height: 0.0,
        };
        retargeter.standing_height = retargeter.standing_height();
        retargeter
    }

    /// Computes the poses at all frames.
    pub(crate) fn poses(&self, motion: &Motion, options: &RetargetOptions) -> Vec<CharacterPose> {
        let mut poses: Vec<CharacterPose> = (0..self.rotations.frames())
            .map(|frame| self.pose(&self.global_rotations(frame), self.pelvis_position(frame)))
            .collect();
        if options.plant_feet {
            legs::plant_feet(self, motion, &mut poses);
        }
        if options.place_hands {
            arms::place_hands(self, &mut poses);
        }
        poses
    }

    /// Returns the rotations of the joints of the motion's body in the world.
    pub(crate) fn global_rotations(&self, frame: usize) -> [DQuat; JOINTS] {
        let local = &self.rotations.local()[frame];
        let mut global = [DQuat::IDENTITY; JOINTS];
        for joint in Joint::ALL {
            let parent = joint
                .parent()
                .map_or(DQuat::IDENTITY, |parent| global[parent.index()]);
            let turn = DQuat::from_array(local[joint.index()].map(f64::from)).normalize();
            global[joint.index()] = parent * turn;
        }
        global
    }

    /// Returns the position of the character's pelvis at a frame.
    fn pelvis_position(&self, frame: usize) -> DVec3 {
        let root = DVec3::from(self.rotations.root()[frame].map(f64::from));
        let lowest = self.source_foot_height();
        let rest_height = self.source_rest[Joint::Pelvis.index()].y - lowest;
        let height = root.y - self.ground;
        let mut place = self.skeleton.facing * (root * self.ratio);
        place.y = self.standing_height + self.ratio * (height - rest_height);
        place
    }

    /// Returns the height of the balls of the feet of the motion's body in its rest pose.
    pub(crate) fn source_foot_height(&self) -> f64 {
        let heights =
            [Joint::LeftFoot, Joint::RightFoot].map(|foot| self.source_rest[foot.index()].y);
        heights[0].min(heights[1])
    }

    /// Returns the height at which the character's pelvis is when its legs are those of the rest pose of the motion's body
    /// and its ankles are as high as in its own rest pose.
    fn standing_height(&self) -> f64 {
        let skeleton = self.skeleton;
        let rest = skeleton.rest_position(Joint::Pelvis).expect("a pelvis");
        let pose = self.pose(&[DQuat::IDENTITY; JOINTS], rest);
        let ankles = [Joint::LeftAnkle, Joint::RightAnkle];
        let lowered = ankles.into_iter().filter_map(|ankle| {
            let place = skeleton.joint(ankle)?;
            Some(skeleton.nodes[place].world_position.y - pose.positions[place].y)
        });
        let lowered: Vec<f64> = lowered.collect();
        rest.y + lowered.iter().sum::<f64>() / lowered.len().max(1) as f64
    }

    /// Computes the pose of the character from the rotations of the motion's body and the position of its pelvis.
    fn pose(&self, source: &[DQuat; JOINTS], pelvis: DVec3) -> CharacterPose {
        let skeleton = self.skeleton;
        let count = skeleton.nodes.len();
        let mut rotations: Vec<Option<DQuat>> = vec![None; count];
        let facing = skeleton.facing;
        for node in &self.driven {
            let source = match node.source {
                RotationSource::Joint(joint) => source[joint.index()],
                RotationSource::Spine(height) => {
                    let below = (height.floor() as usize).min(SPINE.len() - 2);
                    let [from, to] = [below, below + 1].map(|place| source[SPINE[place].index()]);
                    from.slerp(to, height - below as f64)
                }
            };
            let turn = facing * source * facing.inverse();
            rotations[node.place] =
                Some(turn * node.alignment * skeleton.nodes[node.place].world_rotation);
        }
        self.place_nodes(&rotations, pelvis)
    }

    /// Computes positions and rotations of all nodes. Nodes without a rotation in the world keep the one that they have
    /// relative to their parents in the rest pose.
    pub(crate) fn place_nodes(&self, world: &[Option<DQuat>], pelvis: DVec3) -> CharacterPose {
        let skeleton = self.skeleton;
        let pelvis_rest = skeleton.rest_position(Joint::Pelvis).expect("a pelvis");
        let mut pose = CharacterPose {
            positions: Vec::with_capacity(skeleton.nodes.len()),
            rotations: Vec::with_capacity(skeleton.nodes.len()),
        };
        for (place, node) in skeleton.nodes.iter().enumerate() {
            let (position, rotation) = match node.parent {
                None => (node.world_position, node.world_rotation),
                Some(parent) => {
                    let scale = skeleton.nodes[parent].world_scale;
                    let [at, turn] = [pose.positions[parent], scale * node.translation];
                    (
                        at + pose.rotations[parent] * turn,
                        pose.rotations[parent] * node.rotation,
                    )
                }
            };
            let rotation = world[place].unwrap_or(rotation);
            pose.positions.push(match place == skeleton.carrier {
                // What carries the body is where the pelvis comes to its place.
                true => {
                    let offset = pelvis_rest - node.world_position;
                    pelvis - rotation * (node.world_rotation.inverse() * offset)
                }
                false => position,
            });
            pose.rotations.push(rotation);
        }
        pose
    }

    /// Returns the places of the nodes that the motion turns.
    pub(crate) fn driven_places(&self) -> impl Iterator<Item = usize> + '_ {
        self.driven.iter().map(|node| node.place)
    }
}

/// Finds the nodes that a motion turns, and how each of them is aligned.
fn driven_nodes(skeleton: &CharacterSkeleton, source_rest: &[DVec3; JOINTS]) -> Vec<DrivenNode> {
    let mut driven = Vec::new();
    let alignment = |bone: (Joint, Joint)| {
        let [from, to] = [bone.0, bone.1].map(|joint| skeleton.rest_position(joint));
        let own = (to? - from?).try_normalize()?;
        let source = source_rest[bone.1.index()] - source_rest[bone.0.index()];
        let source = (skeleton.facing * source).try_normalize()?;
        Some(DQuat::from_rotation_arc(own, source))
    };
    for joint in Joint::ALL {
        let Some(place) = skeleton.joint(joint) else {
            continue;
        };
        if matches!(joint, Joint::Spine1 | Joint::Spine2 | Joint::Spine3) {
            continue;
        }
        // Hands lie in the line of the forearm.
        let bone = LIMB_BONES.into_iter().find(|bone| {
            bone.0 == joint
                || (bone.1 == joint && matches!(joint, Joint::LeftWrist | Joint::RightWrist))
        });
        driven.push(DrivenNode {
            place,
            alignment: bone.and_then(alignment).unwrap_or(DQuat::IDENTITY),
            source: RotationSource::Joint(joint),
        });
    }
    if skeleton.joint(Joint::Pelvis) != Some(skeleton.carrier) {
        driven.push(DrivenNode {
            place: skeleton.carrier,
            alignment: DQuat::IDENTITY,
            source: RotationSource::Joint(Joint::Pelvis),
        });
    }
    let is_joint = |place: usize| driven.iter().any(|node| node.place == place);
    let line = skeleton.spine.iter().chain(&skeleton.neck).copied();
    let line: Vec<DrivenNode> = { line.filter(|(place, _)| !is_joint(*place)) }
        .map(|(place, height)| DrivenNode {
            place,
            alignment: DQuat::IDENTITY,
            source: RotationSource::Spine(height),
        })
        .collect();
    driven.extend(line);
    driven
}
