/** Files that are dropped on the page, or chosen: the place for them is the file's input. */
import { from } from "./policies.js";

const MEGABYTE = 1e6;

/**
 * Takes what is dropped anywhere on the page into a form's input.
 * @param {HTMLFormElement} form with a .drop, a [name=file] and a [name=name]
 * @param {() => boolean} busy while it is, nothing is taken
 */
export function dropping(form, busy) {
  const place = /** @type {HTMLElement} */ (form.querySelector(".drop"));
  const input = /** @type {HTMLInputElement} */ (form.querySelector("[name=file]"));
  for (const kind of ["dragenter", "dragover"]) {
    addEventListener(kind, (event) => {
      if (!(/** @type {DragEvent} */ (event).dataTransfer?.types.includes("Files"))) return;
      event.preventDefault();
      if (busy()) return;
      from("upload");
      place.classList.add("over");
    });
  }
  addEventListener("dragleave", (event) => event.relatedTarget || place.classList.remove("over"));
  addEventListener("drop", (event) => {
    place.classList.remove("over");
    if (!event.dataTransfer?.files.length) return;
    event.preventDefault();
    if (busy()) return;
    input.files = event.dataTransfer.files;
    input.dispatchEvent(new Event("change", { bubbles: true }));
    input.focus();
  });
  const said = /** @type {HTMLElement} */ (form.querySelector("[data-chosen]"));
  const before = said.innerHTML;
  input.addEventListener("change", () => show(form, place, said, input.files?.[0]));
  const name = /** @type {HTMLInputElement} */ (form.elements.namedItem("name"));
  name.addEventListener("input", () => keepName(form));
  form.addEventListener("reset", () => {
    keepName(form);
    place.classList.remove("chosen");
    said.innerHTML = before;
  });
}

/** The name that stands is not the file's: another file leaves it. @param {HTMLFormElement} form */
export function keepName(form) {
  delete (/** @type {HTMLInputElement} */ (form.elements.namedItem("name")).dataset.ofFile);
}

/**
 * Says which file is chosen, and names the policy after it unless somebody gave it a name.
 * @param {HTMLFormElement} form
 * @param {HTMLElement} place
 * @param {HTMLElement} said
 * @param {File | undefined} file
 */
function show(form, place, said, file) {
  place.classList.toggle("chosen", Boolean(file));
  if (!file) return;
  said.textContent = `${file.name}, ${(file.size / MEGABYTE).toFixed(1)} MB`;
  const name = /** @type {HTMLInputElement} */ (form.elements.namedItem("name"));
  if (name.value && name.value !== name.dataset.ofFile) return;
  name.value = file.name.replace(/\.[a-z]+$/i, "").replace(/[^A-Za-z0-9 _.:+-]/g, "_").slice(0, 80);
  name.dataset.ofFile = name.value;
}
