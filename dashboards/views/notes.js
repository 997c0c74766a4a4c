"use strict";
// Notes and pins on designs: those of the study, and on a served page a form for the chosen design.
const Notes = (() => {
  const LONGEST = 2000;
  const { element } = Dom;

  const keyOf = ({ trial, point }) => (point === null ? String(trial) : `${trial}.${point}`);

  function view(root, app) {
    const { clip, number } = app;
    const list = element("ul");
    const label = element("label", { htmlFor: "note-text" });
    const text = element("textarea", { id: "note-text", maxLength: LONGEST });
    const pin = element("input", { type: "checkbox" });
    const status = element("small", { role: "status" });
    const form = element("form", { onsubmit: save }, label, text, element("label", {}, pin, " pinned"), " ", status, element("button", { type: "submit", textContent: "save" }));
    root.append(element("h2", { textContent: "Notes" }), list, form);
    let [shown, edited] = [null, null];

    function item(note) {
      const key = keyOf(note);
      const row = shown.page.budgets.contenders.concat(shown.rows).find((one) => shown.columns.trial?.values[one] === note.trial);
      const name = `${note.pinned ? "★ " : ""}Trial ${number(note.trial)}${note.point === null ? "" : `, point ${number(note.point)}`}`;
      const choose = () => app.change({ chosen: note.point === null ? app.keyOf(row) : key });
      return element("li", {}, Dom.button(name, choose, { disabled: note.point === null && row === undefined }), ` ${clip(note.text, LONGEST)}`);
    }

    function fill() {
      const { page, subject: chosen, columns } = shown;
      form.hidden = !Details.isServed(page) || !chosen.key || !columns.point;
      if (form.hidden) return;
      label.textContent = `on trial ${number(chosen.value("trial"))}, point ${number(chosen.value("point"))}`;
      const note = (page.design_notes ?? []).find((one) => keyOf(one) === chosen.key) ?? null;
      const now = JSON.stringify([chosen.key, note]);
      if (now === edited) return; // what is being written stays
      edited = now;
      text.value = note?.text ?? "";
      pin.checked = note?.pinned ?? false;
      status.textContent = "";
    }

    async function save(event) {
      event.preventDefault();
      const [trial, point] = ["trial", "point"].map(shown.subject.value);
      const body = JSON.stringify({ trial, point, text: text.value, pinned: pin.checked });
      status.textContent = "…";
      try {
        const answer = await fetch(Details.address("note", {}), { method: "POST", body });
        status.textContent = answer.ok ? "saved" : await answer.text();
      } catch {
        status.textContent = "not saved: the connection is lost";
      }
    }

    function render(next) {
      shown = next;
      const notes = shown.page.design_notes ?? [];
      root.hidden = !notes.length && !Details.isServed(shown.page);
      if (root.hidden || shown.moving) return;
      list.replaceChildren(...notes.map(item));
      fill();
    }

    return { render };
  }

  return { view, keyOf, tabs: ["choose", "inside"] };
})();
Views.notes = Notes;
