/** Buttons that copy a text of the page, and say so. */

export function offerCopies() {
  for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-copy]"))) {
    button.hidden = false;
    button.addEventListener("click", () => copy(button));
  }
}

/** @param {HTMLButtonElement} button */
async function copy(button) {
  const text = /** @type {HTMLElement} */ (document.getElementById(button.dataset.copy ?? ""));
  const done = await copied(text);
  button.textContent = done ? "Copied" : "Press Ctrl+C";
  button.setAttribute("aria-live", "polite");
  setTimeout(() => (button.textContent = "Copy"), 2000);
}

/** Without a secure connection there is no clipboard: then the text is selected. @param {HTMLElement} text */
async function copied(text) {
  try {
    await navigator.clipboard.writeText(text.textContent ?? "");
    return true;
  } catch {
    getSelection()?.selectAllChildren(text);
    return false;
  }
}
