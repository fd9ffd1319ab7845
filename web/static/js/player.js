/** Plays an episode: by the viewer at its own pace, else by a clock that moves timeline and pictures. */

const GLIDE = 100; // ms between two moments that the viewer is given while the clock runs

export class Player {
  /**
   * @param {import("./timeline.js").Timeline} timeline
   * @param {import("./viewer.js").Replay | null} replay
   */
  constructor(timeline, replay) {
    this.timeline = timeline;
    this.replay = replay;
    this.running = 0; // the clock's animation frame
    this.button = document.getElementById("play");
    this.speed = /** @type {HTMLSelectElement | null} */ (document.getElementById("speed"));
    this.speed?.addEventListener("change", () => this.#change());
  }

  get playing() {
    return Boolean(this.running) || Boolean(this.replay?.playing);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.#play();
  }

  pause() {
    this.stop();
    this.replay?.play(false);
  }

  /** Stop the clock; the viewer is told by whoever moves it. */
  stop() {
    cancelAnimationFrame(this.running);
    this.running = 0;
    this.#say();
  }

  /** The viewer is at another moment. @param {number} seconds @param {number} [decision] */
  moved(seconds, decision) {
    if (!this.running) this.timeline.show(seconds, decision);
  }

  /** The viewer began or ended playing by itself. @param {boolean} playing */
  told(playing) {
    if (playing && this.running) this.stop();
    this.#say();
  }

  #play() {
    const from = this.timeline.seconds >= this.timeline.end - 1e-3 ? 0 : this.timeline.seconds;
    if (this.replay?.opened && this.#factor === 1) return void this.replay.play(true, from);
    this.replay?.play(false);
    let before = performance.now();
    let told = 0;
    let seconds = from;
    /** @param {number} now */
    const tick = (now) => {
      seconds += (Math.max(now - before, 0) / 1000) * this.#factor;
      before = now;
      this.timeline.show(seconds);
      if (now - told > GLIDE) {
        this.replay?.glide(this.timeline.seconds, this.timeline.decision);
        told = now;
      }
      if (seconds < this.timeline.end) this.running = requestAnimationFrame(tick);
      else this.timeline.go(this.timeline.end);
    };
    this.running = requestAnimationFrame(tick);
    this.#say();
  }

  get #factor() {
    return Number(this.speed?.value ?? 1);
  }

  #change() {
    if (!this.playing) return;
    this.pause();
    this.#play();
  }

  #say() {
    if (this.button) this.button.textContent = this.playing ? "Pause" : "Play";
  }
}
