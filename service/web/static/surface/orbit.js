// Where the eye is: it turns about a point of the scene.

/** Field of view from top to bottom, radians. */
const FIELD = 0.75;

/** The eye, at `distance` metres from the centre, `yaw` to the right and `pitch` above it, radians. */
export class Orbit {
  constructor() {
    this.home = { yaw: 0.32, pitch: 0.26, distance: 3, x: 0, y: 0 };
    this.reset();
  }

  reset() {
    Object.assign(this, this.home);
  }

  /** Where to stand so that a scene of those half sizes, metres, is seen whole in a picture of that aspect. */
  fit(halfWidth, halfHeight, halfDepth, aspect) {
    const followed = this.distance === this.home.distance;
    const half = Math.max(halfHeight, halfWidth / aspect);
    this.home.distance = Math.max(0.1, (1.08 * half) / Math.tan(FIELD / 2) + 0.6 * halfDepth);
    if (followed) this.distance = this.home.distance;
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + pitch));
  }

  zoom(factor) {
    const { distance } = this.home;
    this.distance = Math.max(distance / 20, Math.min(distance * 5, this.distance * factor));
  }

  /** Move the scene in the plane of the picture, in picture heights. */
  shift(right, up) {
    const height = 2 * this.distance * Math.tan(FIELD / 2);
    this.x += right * height;
    this.y += up * height;
  }

  /** Projection × view, column by column. */
  matrix(aspect) {
    const f = 1 / Math.tan(FIELD / 2), near = this.distance / 50, far = this.distance * 20;
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const fx = f / aspect, a = (far + near) / (near - far), b = (2 * far * near) / (near - far);
    const rotation = [[cy, 0, sy], [sp * sy, cp, -sp * cy], [-cp * sy, sp, cp * cy]];
    const m = new Float32Array(16);
    for (let c = 0; c < 3; c++) {
      m[4 * c] = fx * rotation[0][c];
      m[4 * c + 1] = f * rotation[1][c];
      m[4 * c + 2] = a * rotation[2][c];
      m[4 * c + 3] = -rotation[2][c];
    }
    m[12] = fx * this.x;
    m[13] = f * this.y;
    m[14] = -a * this.distance + b;
    m[15] = this.distance;
    return m;
  }
}
