// The player: the time and the options of the view.

const SPEEDS = [0.1, 0.25, 0.5, 0.75, 1, 1.5, 2];

class Player {
  /** `changed` is called whenever the picture must be drawn again. */
  constructor(frames, rate, changed) {
    Object.assign(this, { frames, rate, changed });
    this.time = 0;
    this.playing = false;
    this.speed = 1;
    this.loop = true;
    this.overlay = false;
    this.follow = false;
    this.trails = false;
  }

  /** The time from the first frame to the last one, in seconds. */
  get duration() {
    return (this.frames - 1) / this.rate;
  }

  /** The nearest frame, counted from 0. */
  get frame() {
    return Math.round(this.time * this.rate);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.changed();
  }

  /** Goes to a frame and pauses. */
  goTo(frame) {
    this.playing = false;
    this.seek(Math.round(frame) / this.rate);
  }

  /** Moves by a number of frames; from a time between two frames to the next frame in that direction. */
  step(frames) {
    const place = this.time * this.rate;
    const from = Math.abs(place - Math.round(place)) < 1e-6 ? Math.round(place) : frames > 0 ? Math.floor(place) : Math.ceil(place);
    this.goTo(from + frames);
  }

  play() {
    if (this.duration === 0) return;
    if (this.time >= this.duration) this.time = 0;
    this.playing = true;
    this.changed();
  }

  pause() {
    this.playing = false;
    this.changed();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  /** Changes the speed by a number of places in SPEEDS. */
  faster(places) {
    const place = SPEEDS.indexOf(this.speed) + places;
    this.set("speed", SPEEDS[Math.min(Math.max(place, 0), SPEEDS.length - 1)]);
  }

  set(name, value) {
    this[name] = value;
    this.changed();
  }

  /** Advances the time after a number of seconds of real time. */
  advance(seconds) {
    if (!this.playing) return;
    // After a pause by the browser, such as that of a hidden tab, the motion continues where it was.
    const time = this.time + Math.min(seconds, 0.25) * this.speed;
    if (time < this.duration) this.time = time;
    else if (this.loop) this.time = (time - this.duration) % this.duration;
    else {
      this.time = this.duration;
      this.playing = false;
    }
  }
}
