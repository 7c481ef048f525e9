/// The time that is shown: standing, or running at a multiple of the recording's time.
export class Player {
  static readonly kSpeeds = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20];

  playing = false;
  speed = 1;
  private t: number;

  constructor(
    readonly begin: number,
    readonly end: number,
  ) {
    this.t = begin;
  }

  get time(): number {
    return this.t;
  }
  seek(t: number): void {
    if (!Number.isNaN(t)) this.t = Math.min(Math.max(t, this.begin), this.end);
  }
  toggle(): void {
    if (!this.playing && this.t >= this.end) this.t = this.begin;
    this.playing = !this.playing && this.end > this.begin;
  }
  /// The next slower or faster speed.
  change_speed(steps: number): void {
    const speeds = Player.kSpeeds;
    const i = speeds.findIndex((speed) => speed >= this.speed);
    this.speed = speeds[Math.min(Math.max((i < 0 ? speeds.length - 1 : i) + steps, 0), speeds.length - 1)]!;
  }
  /// `elapsed`: seconds since the last call. Stops at the end. Returns whether the time has changed.
  advance(elapsed: number): boolean {
    if (!this.playing) return false;
    this.seek(this.t + elapsed * this.speed);
    if (this.t >= this.end) this.playing = false;
    return true;
  }
}
