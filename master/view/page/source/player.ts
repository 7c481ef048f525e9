/// The time that is shown: standing, or running at a multiple of the recording's time.
export class Player {
  static readonly kSpeeds = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20];

  playing = false;
  speed = 1;
  /// The newest time of a recording that grows is shown.
  following = false;
  private t: number;

  /// `grows`: the recording gets longer while it is shown.
  constructor(
    public begin: number,
    public end: number,
    readonly grows = false,
  ) {
    this.t = begin;
    this.following = grows;
  }

  /// The recording has the times from `begin` to `end` now.
  grow(begin: number, end: number): void {
    this.begin = begin;
    this.end = end;
    this.t = this.following ? end : Math.max(this.t, begin);
  }
  /// Shows the newest time from now on.
  follow(): void {
    this.playing = false;
    this.following = true;
    this.t = this.end;
  }

  get time(): number {
    return this.t;
  }
  seek(t: number): void {
    if (Number.isNaN(t)) return;
    this.t = Math.min(Math.max(t, this.begin), this.end);
    this.following = this.grows && t >= this.end;
    if (this.following) this.playing = false;
  }
  toggle(): void {
    if (this.following) {
      this.following = false;
      return;
    }
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
    if (!this.playing || this.following) return false;
    this.seek(this.t + elapsed * this.speed);
    if (this.t >= this.end) this.playing = false;
    return true;
  }
}
