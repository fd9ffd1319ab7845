/**
 * The hidden-state timeline as a slider: click, drag, arrow keys; time is in simulated seconds.
 *
 * A decision that did not move the arm took no time: then several begin at one moment, and it
 * takes the decision's number to say which of them is shown.
 */
const SAME = 1e-3; // seconds

export class Timeline {
  /**
   * @param {HTMLElement} slider
   * @param {(seconds: number) => void} seek called when the reader moves it
   */
  constructor(slider, seek) {
    this.slider = slider;
    this.end = Number(slider.dataset.end);
    this.scale = Number(slider.dataset.scale); // seconds over the whole width
    this.moments = (slider.dataset.moments ?? "0").split(" ").map(Number);
    this.seconds = 0;
    this.decision = 0; // that is under way; after the last one, the end
    this.seek = seek;
    this.spans = Array.from(slider.querySelectorAll("[data-said]"), (span) => {
      const { begin, end, said } = /** @type {SVGElement} */ (span).dataset;
      return { begin: Number(begin), end: Number(end), said };
    });
    this.cursor = /** @type {SVGLineElement} */ (slider.querySelector(".cursor"));
    slider.addEventListener("pointerdown", (event) => this.#drag(event));
    slider.addEventListener("keydown", (event) => this.#key(event));
    this.show(0);
  }

  /** Move the cursor, without a call of `seek`. @param {number} seconds @param {number} [decision] */
  show(seconds, decision) {
    const stays = Math.abs(seconds - this.seconds) < SAME && decision === undefined;
    this.seconds = Math.min(Math.max(seconds, 0), this.end);
    if (!stays) this.decision = decision ?? this.#underWay();
    const at = `${(100 * this.seconds) / this.scale}%`;
    this.cursor.setAttribute("x1", at);
    this.cursor.setAttribute("x2", at);
    this.slider.setAttribute("aria-valuenow", this.seconds.toFixed(3));
    this.slider.setAttribute("aria-valuetext", this.#told());
    this.slider.dispatchEvent(new CustomEvent("moved", { detail: this.seconds }));
  }

  /** Move the cursor, and the viewer with it. @param {number} seconds @param {number} [decision] */
  go(seconds, decision) {
    this.show(seconds, decision);
    this.seek(this.seconds);
  }

  /**
   * One decision on or back, or a tenth of a second.
   * @param {number} way @param {boolean} [finely] @returns {boolean} true: it is done
   */
  step(way, finely = false) {
    const within = this.seconds > this.moments[this.decision] + SAME;
    const next = Math.max(this.decision + (way < 0 && within ? 0 : way), 0);
    if (finely) this.go(this.seconds + way / 10);
    else if (next < this.moments.length) this.go(this.moments[next], next);
    else this.go(this.end);
    return true;
  }

  /** The last decision that had begun. */
  #underWay() {
    const after = this.moments.findIndex((moment) => moment > this.seconds + 1e-6);
    return (after < 0 ? this.moments.length : after) - 1;
  }

  /** What a screen reader says: the time, the decision, the hidden state, the stage. */
  #told() {
    const last = this.decision >= this.moments.length - 1;
    const where = last ? "end" : `decision ${this.decision}`;
    const now = this.spans.filter(({ begin, end }) => begin <= this.seconds && (this.seconds < end || end >= this.end));
    return [`${this.seconds.toFixed(2)} s`, where, ...now.map(({ said }) => said)].join(", ");
  }

  /** @param {PointerEvent} event */
  #drag(event) {
    if (event.button !== 0) return;
    const box = this.slider.getBoundingClientRect();
    /** @param {PointerEvent} at */
    const move = (at) => this.go(((at.clientX - box.left) / box.width) * this.scale);
    const stop = () => this.slider.removeEventListener("pointermove", move);
    this.slider.setPointerCapture(event.pointerId);
    this.slider.addEventListener("pointermove", move);
    this.slider.addEventListener("pointerup", stop, { once: true });
    this.slider.addEventListener("pointercancel", stop, { once: true });
    move(event);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
    if (way) {
      event.preventDefault();
      this.step(way, event.shiftKey);
      return;
    }
    /** @type {Record<string, number>} */
    const places = {
      PageDown: this.seconds - this.end / 10,
      PageUp: this.seconds + this.end / 10,
      Home: 0,
      End: this.end,
    };
    if (!(event.key in places)) return;
    event.preventDefault();
    this.go(places[event.key]);
  }
}
