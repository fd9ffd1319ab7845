/** Another run of the same episode: its timeline and its decisions follow this one's, aligned where they part. */
import { Timeline } from "./timeline.js";

export class Beside {
  /** @param {HTMLElement} section @param {Timeline} ours */
  constructor(section, ours) {
    this.ours = ours;
    this.shift = Number(section.dataset.shift);
    const slider = /** @type {HTMLElement} */ (section.querySelector("#other-timeline"));
    this.theirs = new Timeline(slider, () => this.#lead());
    this.places = section.querySelectorAll("[data-place]");
  }

  /** The other run's decision that is shown. */
  get decision() {
    return this.theirs.decision;
  }

  /** Go where this run is. */
  follow() {
    this.theirs.show(...counterpart(this.ours, this.theirs, this.shift));
    for (const place of this.places) {
      const of = place.getAttribute("data-place") === "here" ? this.ours : this.theirs;
      place.textContent = of.decision < of.moments.length - 1 ? `decision ${of.decision}` : "the end";
    }
  }

  /** The reader moved the other timeline: this run goes along. */
  #lead() {
    this.ours.go(...counterpart(this.theirs, this.ours, -this.shift));
  }
}

/**
 * The moment of a run that stands beside another's: the same share of the counterpart of its decision.
 * @param {Timeline} from @param {Timeline} to @param {number} shift
 * @returns {[number, number]} seconds, decision
 */
function counterpart(from, to, shift) {
  const number = from.decision + shift;
  if (number < 0) return [0, 0];
  if (number >= to.moments.length - 1) return [to.end, to.moments.length - 1];
  const begin = from.moments[from.decision];
  const length = (from.moments[from.decision + 1] ?? from.end) - begin;
  const share = length > 0 ? Math.min((from.seconds - begin) / length, 0.999) : 0;
  return [to.moments[number] + share * (to.moments[number + 1] - to.moments[number]), number];
}
