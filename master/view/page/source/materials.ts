import * as three from 'three';

/// Light from the sky (mixed with that from the ground) and from the sun, in the world: radiant exitance of a white surface.
const kLight = `
vec3 matte_light(const in vec3 normal) {
  vec3 sky = 1.7 * mix(vec3(0.205, 0.235, 0.279), vec3(1.0), 0.5 + 0.5 * normal.z);
  return (sky + 1.9 * max(dot(normal, normalize(vec3(2.0, -3.0, 5.0))), 0.0)) * RECIPROCAL_PI;
}
varying vec3 front_light;
varying vec3 back_light;
`;
const kVertex = `
#include <beginnormal_vertex>
#include <defaultnormal_vertex>
vec3 matte_normal = normalize(inverseTransformDirection(transformedNormal, viewMatrix));
front_light = matte_light(matte_normal);
back_light = matte_light(-matte_normal);
`;

/// A matte surface. Its light is calculated for each corner, not for each pixel: where the processor draws, that takes a fraction of the time of
/// three's MeshLambertMaterial. The light is that of `kLight`; lights of the scene do not count.
export function matte(parameters: three.MeshBasicMaterialParameters): three.MeshBasicMaterial {
  const material = new three.MeshBasicMaterial(parameters);
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace('void main() {', `${kLight}void main() {`).replace('#include <begin_vertex>', `${kVertex}#include <begin_vertex>`);
    shader.fragmentShader = shader.fragmentShader
      .replace('void main() {', 'varying vec3 front_light;\nvarying vec3 back_light;\nvoid main() {')
      .replace('#include <color_fragment>', '#include <color_fragment>\ndiffuseColor.rgb *= gl_FrontFacing ? front_light : back_light;');
  };
  material.customProgramCacheKey = () => 'matte';
  return material;
}
