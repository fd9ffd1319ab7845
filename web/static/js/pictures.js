/** What the cameras saw at the decision that is shown, on the page and at full size. */

/** @param {string} episode @param {number} decision @param {string} camera */
function address(episode, decision, camera) {
  return `/api/v1/episodes/${episode}/observations/${decision}/${camera}.jpg`;
}

export class Pictures {
  /** @param {string} episode the page's own */
  constructor(episode) {
    this.episode = episode;
    this.images = /** @type {NodeListOf<HTMLImageElement>} */ (document.querySelectorAll("img[data-episode]"));
    this.caption = document.getElementById("seen");
    for (const image of this.images) {
      image.addEventListener("error", () => image.classList.add("missing"));
      image.addEventListener("load", () => image.classList.remove("missing"));
    }
  }

  /**
   * @param {number} decision of the page's episode
   * @param {number} other of the run beside it
   * @param {number} last
   */
  show(decision, other, last) {
    for (const image of this.images) this.#turn(image, image.dataset.episode === this.episode ? decision : other);
    if (this.caption) this.caption.textContent = decision < last ? `Seen before decision ${decision}` : "Seen at the end";
  }

  /** @param {HTMLImageElement} image @param {number} decision */
  #turn(image, decision) {
    const { episode = "", camera = "", last } = image.dataset;
    const wanted = address(episode, Math.min(decision, Number(last)), camera);
    if (image.getAttribute("src") !== wanted) image.src = wanted;
    if (decision < Number(last)) new Image().src = address(episode, decision + 1, camera); // the next one is there at once
  }
}

export class Large {
  /** @param {string} episode @param {(way: number) => void} step */
  constructor(episode, step) {
    this.episode = episode;
    this.dialog = /** @type {HTMLDialogElement} */ (document.getElementById("large"));
    this.image = /** @type {HTMLImageElement} */ (document.getElementById("large-picture"));
    this.choices = /** @type {NodeListOf<HTMLElement>} */ (this.dialog.querySelectorAll("[data-choose]"));
    this.camera = this.choices[0].dataset.choose ?? "";
    this.decision = 0;
    this.named = "";
    this.dialog.addEventListener("click", (event) => {
      const target = /** @type {HTMLElement} */ (event.target);
      if (target === this.dialog) this.dialog.close(); // beside the picture
      if (target.dataset.step) step(Number(target.dataset.step));
      if (target.dataset.choose) this.#look(target.dataset.choose);
    });
  }

  /** @param {string} [camera] */
  open(camera) {
    if (!document.querySelector(".camera")) return; // nothing was recorded
    this.#look(camera ?? this.camera);
    if (!this.dialog.open) this.dialog.showModal();
  }

  /** @param {number} number of the camera */
  choose(number) {
    this.#look(this.choices[number]?.dataset.choose ?? this.camera);
  }

  /** @param {number} decision @param {string} named */
  show(decision, named) {
    [this.decision, this.named] = [decision, named];
    if (this.dialog.open) this.#look(this.camera);
  }

  /** @param {string} camera */
  #look(camera) {
    const name = `${camera.replaceAll("_", " ")} camera`;
    this.camera = camera;
    this.image.src = address(this.episode, this.decision, camera);
    this.image.alt = `${name}, ${this.named}`;
    /** @type {HTMLElement} */ (document.getElementById("large-title")).textContent = name;
    /** @type {HTMLElement} */ (document.getElementById("large-now")).textContent = this.named;
    for (const choice of this.choices) choice.setAttribute("aria-pressed", `${choice.dataset.choose === camera}`);
  }
}
