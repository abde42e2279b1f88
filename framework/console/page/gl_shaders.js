// @ts-check
// The programs of the renderer: vertex and fragment shader of each kind of thing.

const HEAD = `#version 300 es
precision highp float;
precision highp int;
uniform mat4 u_clip;
uniform vec2 u_size;
`;

/** Segments as quads of a width in pixels, since lines of WebGL are never wider than one. */
const lines = [`${HEAD}
in vec3 a_from;
in vec3 a_to;
in vec4 a_colour;
in vec4 a_style;
uniform float u_pixel;
out vec4 v_colour;
out vec4 v_place;
void main() {
  vec4 p = u_clip * vec4(a_from, 1.0), q = u_clip * vec4(a_to, 1.0);
  float dp = p.z + p.w, dq = q.z + q.w;
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  v_colour = a_colour;
  v_place = vec4(0.0);
  if (dp <= 0.0 && dq <= 0.0) return;
  vec4 a = p, b = q;
  if (dp < 0.0) a = p + (q - p) * (dp / (dp - dq));
  if (dq < 0.0) b = q + (p - q) * (dq / (dq - dp));
  vec2 from = 0.5 * u_size * a.xy / a.w, to = 0.5 * u_size * b.xy / b.w;
  float length_px = distance(from, to);
  vec2 along = length_px > 1e-4 ? (to - from) / length_px : vec2(1.0, 0.0);
  float half_px = 0.125 * a_style.x * 0.5 * u_pixel, side = float(gl_VertexID & 1) * 2.0 - 1.0;
  bool end = gl_VertexID > 1;
  vec4 c = end ? b : a;
  vec2 place = (end ? to : from) + vec2(-along.y, along.x) * side * (half_px + 1.0);
  gl_Position = vec4(place / (0.5 * u_size), c.z / c.w, 1.0);
  v_place = vec4(side * (half_px + 1.0), half_px, end ? length_px : 0.0, a_style.y * u_pixel);
}`, `${HEAD}
uniform float u_strength;
in vec4 v_colour;
in vec4 v_place;
out vec4 o_colour;
void main() {
  if (v_place.w > 0.0 && mod(v_place.z, 2.0 * v_place.w) > v_place.w) discard;
  float cover = clamp(v_place.y + 0.5 - abs(v_place.x), 0.0, 1.0) * min(1.0, 2.0 * v_place.y);
  if (cover <= 0.0) discard;
  o_colour = vec4(v_colour.rgb, v_colour.a * cover * u_strength);
}`];

/** Ellipsoids as the ellipses that they project to, of at least some pixels. Shape 0: filled, 1: ring, 2: square, 3: a ring around another. */
const sprites = [`${HEAD}
in vec3 a_centre;
in vec3 a_axis0;
in vec3 a_axis1;
in vec3 a_axis2;
in vec4 a_colour;
in vec4 a_style;
uniform vec4 u_eye;
uniform float u_pixel;
out vec4 v_colour;
out vec4 v_place;
flat out int v_shape;
vec2 projected(vec4 centre, vec3 axis) {
  vec4 a = u_clip * vec4(axis, 0.0);
  return 0.5 * u_size * (a.xy * centre.w - centre.xy * a.w) / (centre.w * centre.w);
}
void main() {
  vec4 c = u_clip * vec4(a_centre, 1.0);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  v_colour = a_colour;
  v_place = vec4(0.0);
  v_shape = int(a_style.x + 0.5);
  if (c.z + c.w <= 0.0 || c.w <= 0.0) return;
  vec2 p = projected(c, a_axis0), q = projected(c, a_axis1), r = projected(c, a_axis2);
  float xx = p.x * p.x + q.x * q.x + r.x * r.x, yy = p.y * p.y + q.y * q.y + r.y * r.y, xy = p.x * p.y + q.x * q.y + r.x * r.y;
  float mean = 0.5 * (xx + yy), spread = length(vec2(0.5 * (xx - yy), xy));
  vec2 radii = sqrt(max(vec2(mean + spread, mean - spread), 0.0));
  vec2 main_axis = spread > 1e-9 ? vec2(cos(0.5 * atan(xy, 0.5 * (xx - yy))), sin(0.5 * atan(xy, 0.5 * (xx - yy)))) : vec2(1.0, 0.0);
  float least = 0.125 * a_style.y * u_pixel;
  if (v_shape == 2 && radii.x < least) main_axis = vec2(1.0, 0.0);
  radii = min(max(radii, vec2(least)), vec2(4000.0));
  if (v_shape == 3) radii += 4.0 * u_pixel;
  vec2 corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)) * 2.0 - 1.0;
  vec2 local = corner * (radii + 2.0);
  vec2 place = main_axis * local.x + vec2(-main_axis.y, main_axis.x) * local.y;
  vec3 toward = u_eye.w > 0.5 ? normalize(u_eye.xyz - a_centre) : u_eye.xyz;
  // A little towards the eye: marks lie on surfaces that would hide half of them.
  vec4 nearer = u_clip * vec4(a_centre + 0.01 * toward, 1.0);
  gl_Position = vec4(c.xy / c.w + place / (0.5 * u_size), clamp(nearer.z / nearer.w, -1.0, 1.0), 1.0);
  v_place = vec4(local, radii);
}`, `${HEAD}
uniform float u_pixel;
uniform float u_strength;
in vec4 v_colour;
in vec4 v_place;
flat in int v_shape;
out vec4 o_colour;
void main() {
  vec2 p = v_place.xy, r = v_place.zw;
  float f = length(p / r), inside = min(r.x, r.y);
  float outward = v_shape == 2 ? max(abs(p.x) - r.x, abs(p.y) - r.y) : f < 1e-3 ? -inside : (f - 1.0) * f / length(p / (r * r));
  float wide = (v_shape == 3 ? 1.0 : 1.6) * u_pixel, rim = abs(outward + wide * 0.5) - wide * 0.5;
  float large = smoothstep(10.0, 40.0, inside);
  float cover;
  vec3 colour = v_colour.rgb;
  if (v_shape == 1 || v_shape == 3) {
    cover = clamp(0.5 - rim, 0.0, 1.0);
  } else {
    float body = clamp(0.5 - outward, 0.0, 1.0);
    cover = max(body * mix(1.0, 0.35, large), clamp(0.5 - rim, 0.0, 1.0) * mix(0.0, 0.9, large));
    float high = v_shape == 0 ? sqrt(max(1.0 - f * f, 0.0)) : 1.0;
    colour *= mix(1.0, 0.75 + 0.35 * high, step(3.0, inside));
  }
  if (cover <= 0.0) discard;
  o_colour = vec4(colour, v_colour.a * cover * u_strength);
}`];

const points = [`${HEAD}
in vec3 a_position;
in vec4 a_colour;
uniform float u_metre_px;
uniform float u_least;
out vec4 v_colour;
void main() {
  gl_Position = u_clip * vec4(a_position, 1.0);
  gl_PointSize = clamp(u_metre_px / max(gl_Position.w, 1e-3), u_least, 48.0);
  v_colour = a_colour;
}`, `${HEAD}
in vec4 v_colour;
out vec4 o_colour;
void main() { o_colour = vec4(v_colour.rgb, 1.0); }`];

/** Of a cube only the three faces that can be seen: 18 vertices. */
const voxels = [`${HEAD}
in vec3 a_position;
in vec4 a_colour;
uniform vec4 u_eye;
uniform float u_half;
out vec4 v_colour;
void main() {
  int face = gl_VertexID / 6, corner = gl_VertexID - face * 6;
  vec2 uv = vec2(corner == 1 || corner == 2 || corner == 4 ? 1.0 : -1.0, corner == 2 || corner == 4 || corner == 5 ? 1.0 : -1.0);
  vec3 toward = u_eye.w > 0.5 ? u_eye.xyz - a_position : u_eye.xyz;
  float side = toward[face] > 0.0 ? 1.0 : -1.0;
  vec3 at = face == 0 ? vec3(side, uv) : face == 1 ? vec3(uv.x, side, uv.y) : vec3(uv, side);
  gl_Position = u_clip * vec4(a_position + u_half * at, 1.0);
  v_colour = vec4(a_colour.rgb * (face == 2 ? 1.0 : face == 1 ? 0.72 : 0.86), 1.0);
}`, points[1]];

const meshes = [`${HEAD}
in vec3 a_position;
in vec4 a_colour;
out vec4 v_colour;
out vec3 v_position;
void main() {
  gl_Position = u_clip * vec4(a_position, 1.0);
  v_position = a_position;
  v_colour = a_colour;
}`, `${HEAD}
uniform vec4 u_eye;
in vec4 v_colour;
in vec3 v_position;
out vec4 o_colour;
void main() {
  vec3 normal = normalize(cross(dFdx(v_position), dFdy(v_position)));
  vec3 toward = normalize(u_eye.w > 0.5 ? u_eye.xyz - v_position : u_eye.xyz);
  o_colour = vec4(v_colour.rgb * (0.35 + 0.65 * abs(dot(normal, toward))), 1.0);
}`];

/** The floor: lines of 1 m, and of 0.1 m where they lie far enough apart. */
const floor = [`${HEAD}
uniform vec4 u_extent;
out vec2 v_place;
void main() {
  v_place = mix(u_extent.xy, u_extent.zw, vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)));
  gl_Position = u_clip * vec4(v_place, 0.0, 1.0);
}`, `${HEAD}
uniform vec4 u_extent;
uniform vec4 u_colour;
uniform float u_pixel;
in vec2 v_place;
out vec4 o_colour;
float lines(float step_m, float from, float to) {
  vec2 at = v_place / step_m, wide = max(fwidth(at), 1e-6), away = abs(fract(at - 0.5) - 0.5) / wide;
  vec2 drawn = clamp(0.5 + 0.5 * u_pixel - away, 0.0, 1.0);
  return max(drawn.x, drawn.y) * (1.0 - smoothstep(from, to, max(wide.x, wide.y) * u_pixel));
}
void main() {
  float cover = max(lines(1.0, 0.2, 0.8), 0.4 * lines(0.1, 0.1, 0.25));
  if (cover <= 0.004) discard;
  o_colour = vec4(u_colour.rgb, u_colour.a * cover);
}`];

/** The live picture of a camera behind the scene. */
const picture = [`${HEAD}
uniform vec4 u_extent;
out vec2 v_place;
void main() {
  v_place = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1));
  gl_Position = vec4(mix(u_extent.xy, u_extent.zw, v_place), 1.0, 1.0);
}`, `${HEAD}
uniform sampler2D u_texture;
uniform float u_gray;
in vec2 v_place;
out vec4 o_colour;
void main() {
  vec3 colour = texture(u_texture, v_place).rgb;
  o_colour = vec4((u_gray > 0.5 ? colour.rrr : colour) * 0.8, 1.0);
}`];

export const SHADERS = { lines, sprites, points, voxels, meshes, floor, picture };
