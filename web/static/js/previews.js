/** Stills that move: on hover and focus, or when pressed; of themselves never where motion is unwanted. */

const still = matchMedia("(prefers-reduced-motion: reduce)");

/** @param {ParentNode} [within] cards, each with an image that has a preview and a button */
export function start(within = document) {
  for (const card of /** @type {NodeListOf<HTMLElement>} */ (within.querySelectorAll(".card:has([data-preview])"))) {
    new Preview(card);
  }
}

class Preview {
  /** @param {HTMLElement} card */
  constructor(card) {
    this.image = /** @type {HTMLImageElement} */ (card.querySelector("[data-preview]"));
    this.button = /** @type {HTMLButtonElement} */ (card.querySelector("button.play"));
    this.thumbnail = this.image.src;
    this.pressed = false;
    this.button.addEventListener("click", () => this.press());
    card.querySelector(".picture")?.addEventListener("pointerenter", (event) => {
      if (/** @type {PointerEvent} */ (event).pointerType === "mouse") this.invite();
    });
    card.querySelector(".picture")?.addEventListener("pointerleave", () => this.leave());
    const link = card.querySelector("a.to");
    link?.addEventListener("focus", () => link.matches(":focus-visible") && this.invite());
    link?.addEventListener("blur", () => this.leave());
    this.image.addEventListener("error", () => this.missing());
  }

  invite() {
    if (!still.matches) this.show(true);
  }

  leave() {
    if (!this.pressed) this.show(false);
  }

  press() {
    this.pressed = !this.pressed;
    this.button.setAttribute("aria-pressed", String(this.pressed));
    this.show(this.pressed);
  }

  /** @param {boolean} moving */
  show(moving) {
    const wanted = moving ? String(this.image.dataset.preview) : this.thumbnail;
    if (this.image.src !== new URL(wanted, location.href).href) this.image.src = wanted;
  }

  /** A recording that was removed since has no preview. */
  missing() {
    if (this.image.src === this.thumbnail) return;
    this.button.hidden = true;
    this.image.dataset.preview = this.thumbnail;
    this.image.src = this.thumbnail;
  }
}
