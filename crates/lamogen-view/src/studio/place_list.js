// The list of places or positions: a line for each, with its numbers, how near the motion comes, and a button that removes it.

/**
 * Shows a line for each entry `{ name, title, isSelected, fields, off, change, removed }` of a list. A field is `{ key, text, unit, value, low, high, step }`, with seconds or
 * metres as its unit; `change(key, value)` is called with a new number, `refused()` if what was typed is none. `off` is the distance in metres, undefined while it is not known.
 */
function showPlaceList(list, entries, refused) {
  const focused = list.contains(document.activeElement) ? document.activeElement.dataset.field : null;
  list.replaceChildren();
  entries.forEach(({ name, title, isSelected, fields, off, change, removed }, i) => {
    const item = append(list, "li");
    item.classList.toggle("selected", isSelected);
    append(item, "b", "", title);
    for (const { key, text, unit, value, low, high, step } of fields) {
      const label = append(item, "label");
      append(label, "span", "", text);
      const input = append(label, "input");
      Object.assign(input, { type: "number", value: number(value), min: low, max: high, step, inputMode: "decimal" });
      input.dataset.field = `${i} ${key}`;
      input.setAttribute("aria-label", `${name}: ${text}, in ${unit === "s" ? "seconds" : "metres"}`);
      append(label, "span", "", unit);
      input.addEventListener("change", () => {
        if (input.value !== "" && Number.isFinite(Number(input.value))) change(key, Number(input.value));
        else refused();
      });
    }
    append(item, "output", "note", off === undefined ? "…" : `${(100 * off).toFixed(1)} cm off`);
    const remove = append(item, "button", "", "×");
    remove.type = "button";
    remove.setAttribute("aria-label", `Remove ${name.toLowerCase()}`);
    remove.addEventListener("click", removed);
  });
  if (focused) list.querySelector(`[data-field="${focused}"]`)?.focus();
}
