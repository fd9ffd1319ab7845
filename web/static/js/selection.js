/** Cards that are selected, and the form that labels them all. */
import { add, labelOf, reason } from "./labels.js";

const form = /** @type {HTMLFormElement | null} */ (document.getElementById("label-many"));

/** @returns {HTMLInputElement[]} */
const boxes = () => [...document.querySelectorAll(/** @type {"input"} */ ("input[name=selected]"))];
const selected = () => boxes().filter((box) => box.checked);

/** Show the form while a card is selected. */
export function start() {
  if (!form) return;
  for (const box of boxes()) box.addEventListener("change", show);
  form.addEventListener("submit", onSubmit);
  form.querySelector(".all")?.addEventListener("click", () => tick(true));
  form.querySelector(".none")?.addEventListener("click", () => tick(false));
  show(); // a reload keeps ticks
}

/** Select a card, or no longer. @param {Element} card */
export function toggle(card) {
  const box = /** @type {HTMLInputElement | null} */ (card.querySelector("input[name=selected]"));
  if (!box) return;
  box.checked = !box.checked;
  show();
}

/** @param {boolean} on */
function tick(on) {
  for (const box of boxes()) box.checked = on;
  show();
}

function show() {
  if (!form) return;
  const count = selected().length;
  form.hidden = count === 0;
  status(`${count} selected`);
}

/** @param {string} text */
function status(text) {
  /** @type {HTMLElement} */ (form?.querySelector("[role=status]")).textContent = text;
}

/** @param {SubmitEvent} event */
async function onSubmit(event) {
  event.preventDefault();
  if (!form) return;
  const error = /** @type {HTMLElement} */ (form.querySelector(".error"));
  const label = labelOf(String(new FormData(form).get("label")));
  const wanted = selected();
  error.textContent = "";
  try {
    for (const [n, box] of wanted.entries()) {
      status(`${n + 1} of ${wanted.length} …`);
      await add(box.value, { label });
      box.checked = false; // after a refusal those that are left can be tried again
    }
    form.reset();
  } catch (refused) {
    error.textContent = reason(refused);
  }
  show();
}
