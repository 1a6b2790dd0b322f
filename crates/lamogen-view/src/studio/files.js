// Files: those dropped on the page, and those to keep.

/** The formats to keep a motion in: name, file name extension, media type. */
const EXPORTS = [
  ["GLB", "glb", "model/gltf-binary", "for Blender and engines"],
  ["BVH", "bvh", "text/plain", "for animation programs"],
  ["VRMA", "vrma", "application/x-vrma", "for every VRM character"],
  ["npy", "npy", "application/x-npy", "joints for NumPy"],
  ["CSV", "csv", "text/csv", "Laban features of every frame"],
  ["GIF", "gif", "image/gif", "an animation"],
  ["PNG", "png", "image/png", "a strip with curves"],
  ["Page", "html", "text/html", "a page that plays it"],
  ["JSON", "json", "application/json", "everything"],
];

/** Returns a file name for a sentence. */
function fileStem(prompt) {
  const words = prompt.toLowerCase().normalize("NFKD").replace(/[^a-z0-9]+/g, "-").replace(/^-+|-+$/g, "");
  return words.slice(0, 60) || "motion";
}

/** Lets the browser save bytes as a file. */
function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** Calls `opened(file)` for a file that is dropped on the page or chosen. */
function listenToFiles(input, veil, opened) {
  let depth = 0;
  const hasFiles = (event) => event.dataTransfer?.types.includes("Files");
  const show = () => (veil.hidden = depth === 0);
  document.addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    depth += 1;
    show();
  });
  document.addEventListener("dragleave", (event) => {
    if (!hasFiles(event)) return;
    depth = Math.max(depth - 1, 0);
    show();
  });
  document.addEventListener("dragover", (event) => {
    if (hasFiles(event)) event.preventDefault();
  });
  document.addEventListener("drop", (event) => {
    depth = 0;
    show();
    if (!hasFiles(event)) return;
    event.preventDefault();
    if (event.dataTransfer.files[0]) opened(event.dataTransfer.files[0]);
  });
  input.addEventListener("change", () => {
    if (input.files[0]) opened(input.files[0]);
    // The same file may be chosen again.
    input.value = "";
  });
}

/** Shows the report on a motion file. */
function showReport(parent, { name, report, isLiked }, components, { use, remove }) {
  parent.replaceChildren();
  parent.hidden = false;
  const motion = report.motions[0];
  append(parent, "p", "", `${name}: ${motion.seconds.toFixed(2)} s, ${motion.frames} frames${report.scheme ? `, a skeleton as ${report.scheme}` : ""}`);
  for (const notice of report.notices ?? []) append(parent, "p", "note", notice);
  const table = append(parent, "table");
  const head = append(append(table, "thead"), "tr");
  for (const text of ["", "largest", "mean"]) append(head, "th", "", text).scope = "col";
  const body = append(table, "tbody");
  for (const { name: component, key, unit } of components) {
    const row = append(body, "tr");
    append(row, "th", "", component).scope = "row";
    const { maximum, mean: average } = motion.laban[key];
    append(row, "td", "", maximum.toPrecision(3)).title = unit;
    append(row, "td", "", average.toPrecision(3)).title = unit;
  }
  const sliding = motion.foot_sliding;
  append(parent, "p", "note", `Standing feet slide ${(100 * sliding.speed_m_s).toFixed(1)} cm/s; bones change by up to ${(1000 * motion.bone_drift.largest_m).toFixed(0)} mm; joints turn ${motion.turning.mean_deg.toFixed(1)}° a frame.`);
  appendFileButtons(parent, name, { text: "Make the motion like it", isPressed: isLiked, press: use, remove });
}

/** Appends the buttons of a file that was dropped: one that uses it, pressed or not, and one that removes it. */
function appendFileButtons(parent, name, { text, isPressed, press, remove }) {
  const buttons = append(parent, "div", "buttons");
  const use = append(buttons, "button", "", text);
  use.type = "button";
  use.setAttribute("aria-pressed", String(isPressed));
  use.addEventListener("click", press);
  const away = append(buttons, "button", "", "Remove");
  away.type = "button";
  away.setAttribute("aria-label", `Remove ${name}`);
  away.addEventListener("click", remove);
}
