import * as three from 'three';
import type { Mesh } from './format';
import { matte } from './materials';
import { unpack_bytes } from './packed';
import type { Meshes } from './shapes';

/// Marks parts without a material of their own: they get that of the robot. The normals of STL files are often zero.
function plain(geometry: three.BufferGeometry): three.Object3D {
  geometry.computeVertexNormals();
  const mesh = new three.Mesh(geometry);
  mesh.userData['plain'] = true;
  return mesh;
}

/// Replaces materials by ones that need no textures and draw fast, with the same colour.
function simplify(object: three.Object3D): three.Object3D {
  object.traverse((part) => {
    if (!(part instanceof three.Mesh)) return;
    const geometry = part.geometry as three.BufferGeometry;
    if (geometry.getAttribute('normal') === undefined) geometry.computeVertexNormals();
    const simple = (material: three.Material): three.Material => {
      const colour = (material as three.MeshStandardMaterial).color ?? new three.Color('#c9cdd3');
      return matte({ color: colour, transparent: material.transparent, opacity: material.opacity, side: material.side, vertexColors: material.vertexColors });
    };
    const given = part.material as three.Material | three.Material[];
    part.material = Array.isArray(given) ? given.map(simple) : simple(given);
  });
  return object;
}

/// A glTF or GLB without its images: they would be loaded from other places.
export function without_images(bytes: Uint8Array<ArrayBuffer>, binary: boolean): ArrayBuffer {
  const text = new TextDecoder();
  const strip = (json: string): string => {
    const content = JSON.parse(json) as Record<string, unknown>;
    delete content['images'];
    delete content['textures'];
    for (const material of (content['materials'] ?? []) as Record<string, unknown>[]) {
      for (const key of ['normalTexture', 'occlusionTexture', 'emissiveTexture', 'extensions']) delete material[key];
      const metal = material['pbrMetallicRoughness'] as Record<string, unknown> | undefined;
      if (metal !== undefined) for (const key of ['baseColorTexture', 'metallicRoughnessTexture']) delete metal[key];
    }
    return JSON.stringify(content);
  };
  if (!binary) return new TextEncoder().encode(strip(text.decode(bytes))).buffer as ArrayBuffer;
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const length = view.getUint32(12, true);
  let json = new TextEncoder().encode(strip(text.decode(bytes.subarray(20, 20 + length))));
  const padded = new Uint8Array(Math.ceil(json.length / 4) * 4).fill(0x20);
  padded.set(json);
  json = padded;
  const rest = bytes.subarray(20 + length);
  const made = new Uint8Array(20 + json.length + rest.length);
  const out = new DataView(made.buffer);
  made.set(bytes.subarray(0, 8));
  out.setUint32(8, made.length, true);
  out.setUint32(12, json.length, true);
  out.setUint32(16, 0x4e4f534a, true);
  made.set(json, 20);
  made.set(rest, 20 + json.length);
  return made.buffer;
}

async function read(mesh: Mesh, bytes: Uint8Array<ArrayBuffer>): Promise<three.Object3D> {
  const text = (): string => new TextDecoder().decode(bytes);
  if (mesh.format === 'stl') {
    const { STLLoader } = await import('three/examples/jsm/loaders/STLLoader.js');
    return plain(new STLLoader().parse(bytes.buffer));
  }
  if (mesh.format === 'obj') {
    const { OBJLoader } = await import('three/examples/jsm/loaders/OBJLoader.js');
    const object = new OBJLoader().parse(text());
    object.traverse((part) => {
      part.userData['plain'] = true;
    });
    return object;
  }
  if (mesh.format === 'dae') {
    const { ColladaLoader } = await import('three/examples/jsm/loaders/ColladaLoader.js');
    const manager = new three.LoadingManager();
    manager.setURLModifier(() => 'data:,'); // no image is loaded
    // A URDF takes the coordinates as they are, whatever axis the file calls up.
    const document = text()
      .replace(/<library_images>[\s\S]*?<\/library_images>/g, '')
      .replace(/<up_axis>[^<]*<\/up_axis>/g, '');
    const collada = new ColladaLoader(manager).parse(document, '');
    if (collada === null) throw new Error('it is no COLLADA file');
    return simplify(collada.scene);
  }
  const { GLTFLoader } = await import('three/examples/jsm/loaders/GLTFLoader.js');
  const gltf = await new GLTFLoader().parseAsync(without_images(bytes, mesh.format === 'glb'), '');
  // glTF has y upwards, a URDF z.
  const turned = new three.Group().add(simplify(gltf.scene));
  turned.rotation.x = Math.PI / 2;
  return new three.Group().add(turned);
}

/// Reads the meshes of a page. One that cannot be read is left out, with a remark.
export async function load_meshes(meshes: Mesh[], text: string, remark: (text: string) => void): Promise<Meshes> {
  return Promise.all(
    meshes.map(async (mesh) => {
      try {
        return await read(mesh, await unpack_bytes(text, mesh));
      } catch (error) {
        remark(`mesh ${mesh.name} is left out: ${error instanceof Error ? error.message : String(error)}`);
        return undefined;
      }
    }),
  );
}
