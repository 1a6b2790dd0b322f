// The shapes of the body around its joints. Each shape is the convex hull of a few balls.

/**
 * Returns the parts of a body. Each part has `hulls` of balls [centre, radius in metres] that are painted together, their
 * long `axis` [from, to], and the `tone` of their colour.
 */
function bodyParts(pose, index) {
  const at = (name) => pose[index[name]];
  const beyond = (from, to, metres) => add(to, times(unit(sub(to, from), [0, -1, 0]), metres));
  const parts = [];
  const part = (tone, ...balls) => parts.push({ tone, hulls: [balls], axis: [balls[0][0], balls[balls.length - 1][0]] });
  for (const side of ["left", "right"]) {
    const [hip, knee, ankle, foot] = ["hip", "knee", "ankle", "foot"].map((name) => at(`${side}_${name}`));
    const [shoulder, elbow, wrist] = ["shoulder", "elbow", "wrist"].map((name) => at(`${side}_${name}`));
    part(side, [hip, 0.088], [knee, 0.056]);
    part(side, [knee, 0.056], [mix(knee, ankle, 0.3), 0.058], [ankle, 0.037]);
    part("end", [ankle, 0.04], [mix(foot, ankle, 0.1), 0.036], [beyond(ankle, foot, 0.05), 0.026]);
    part(side, [shoulder, 0.055], [elbow, 0.04]);
    part(side, [elbow, 0.04], [wrist, 0.028]);
    part("end", [wrist, 0.029], [beyond(elbow, wrist, 0.075), 0.037], [beyond(elbow, wrist, 0.13), 0.024]);
  }
  const [pelvis, spine1, spine2, spine3, neck, head] = ["pelvis", "spine1", "spine2", "spine3", "neck", "head"].map(at);
  const chest = ["left_shoulder", "right_shoulder"].map(at).flatMap((shoulder) => [[shoulder, 0.056], [mix(spine2, shoulder, 0.5), 0.085]]);
  parts.push({
    tone: "middle",
    axis: [pelvis, neck],
    hulls: [
      [[at("left_hip"), 0.09], [at("right_hip"), 0.09], [mix(pelvis, spine1, 0.6), 0.105]],
      [[pelvis, 0.1], [mix(spine1, spine2, 0.6), 0.105], [spine3, 0.12]],
      [[spine2, 0.105], ...chest, [mix(spine3, neck, 0.75), 0.07]],
    ],
  });
  part("end", [mix(spine3, neck, 0.95), 0.05], [mix(neck, head, 0.7), 0.044]);

  // The motion has no direction of the head, so the face has the direction of the shoulders.
  const up = unit(sub(head, neck), [0, 1, 0]);
  const across = sub(at("left_shoulder"), at("right_shoulder"));
  const front = unit(cross(across, sub(neck, pelvis)), [0, 0, 1]);
  const face = unit(sub(front, times(up, dot(front, up))), front);
  const from = (above, before) => add(head, add(times(up, above), times(face, before)));
  part("end", [from(0.012, 0.022), 0.067], [from(0.082, -0.008), 0.094]);
  part("nose", [from(0.024, 0.094), 0.016], [from(0.064, 0.086), 0.009]);
  return parts;
}

/** The joints that have trails. */
const TRAIL_JOINTS = ["left_wrist", "right_wrist", "left_foot", "right_foot"];
