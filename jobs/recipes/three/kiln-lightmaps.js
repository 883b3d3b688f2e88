/* Puts kiln's lightmaps on a scene that three.js has loaded from DIR/scene.glb.
 *
 *     const gltf = await new GLTFLoader().loadAsync('out/scene.glb');
 *     await applyKilnLightmaps(gltf, 'out/');
 *     scene.add(gltf.scene);
 *
 * What it does, and what a loader of your own must do too:
 * - unit: three.js (r155 and later) takes a light map as irradiance E and shows albedo * E / pi, which is what kiln writes. So
 *   lightMapIntensity is 1, without a factor of pi; another value is an exposure. MeshStandardMaterial takes off what its specular
 *   layer would reflect, 4 % seen from above and more at a grazing angle, and an environment map gives it back; MeshLambertMaterial does not.
 * - rows: EXRLoader stores an EXR's bottom row first, which puts it at v = 0. In glTF v = 0 is the top row: flipY = true.
 * - UV set: TEXCOORD_1 is `uv1`: texture.channel = 1. Scale and offset go to texture.repeat and texture.offset.
 * - floats: EXRLoader makes half floats unless told; lux of a sunlit floor do not fit in them (65504 is the largest).
 * - channels: a bake's own EXRs hold direct and indirect light too, which EXRLoader of r155 cannot skip (r170 and r187 do): for it write
 *   pages of RGB alone, kiln export --atlas 4096.
 * - lights: those that are in the lightmaps (extras.kiln_baked) light the scene twice unless they are switched off, or left out of the
 *   file by kiln export --drop-baked-lights.
 */
import * as THREE from 'three';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';

/* The page as a texture whose v = 0 is the page's top row. */
async function loadPage(url, type) {
  const texture = await new EXRLoader().setDataType(type).loadAsync(url);
  texture.flipY = true;
  texture.colorSpace = THREE.NoColorSpace;
  texture.wrapS = texture.wrapT = THREE.ClampToEdgeWrapping;
  texture.minFilter = texture.magFilter = THREE.LinearFilter;
  texture.generateMipmaps = false;
  texture.needsUpdate = true;
  return texture;
}

/* [object, its lightmap's entry] of every node that was baked. */
function bakedNodes(root) {
  const found = [];
  root.traverse((object) => {
    const entry = object.userData.kiln_lightmap ?? object.userData.gltfExtensions?.KILN_lightmap;
    if (entry?.instances !== undefined) console.warn(`kiln: ${object.name} is drawn as instances, each with a lightmap of its own: left out`);
    if (entry?.file !== undefined) found.push([object, entry]);
  });
  return found;
}

/* The meshes of one node: itself, or the parts that GLTFLoader made of it, which are no nodes of the file. */
function meshesOf(object, associations) {
  const parts = object.children.filter((child) => associations.get(child)?.nodes === undefined);
  return [...(object.isMesh ? [object] : []), ...parts.flatMap((part) => meshesOf(part, associations))];
}

/* gltf: what GLTFLoader gave. base: URL of the folder that scene.glb is in, ending in '/'. Returns {nodes, pages, lights, unit}: how
 * many nodes got a lightmap, from how many images, how many lights were switched off, and what a lightmap's value of 1 means. */
export async function applyKilnLightmaps(gltf, base, { intensity = 1, type = THREE.FloatType, keepLights = false } = {}) {
  const nodes = bakedNodes(gltf.scene), pages = new Map(), materials = new Map();
  if (nodes.length === 0) throw new Error('no node of this scene has a lightmap: load the scene.glb that kiln wrote beside its lightmaps');
  for (const [, entry] of nodes) {
    if (entry.encoding !== 'exr') throw new Error(`the lightmaps are ${entry.encoding}: this recipe reads EXR (kiln export --format exr)`);
    if (!pages.has(entry.file)) pages.set(entry.file, loadPage(new URL(entry.file, new URL(base, document.baseURI)), type));
  }
  for (const [object, entry] of nodes) {
    const lightMap = (await pages.get(entry.file)).clone(); // shares the image; repeat and offset are the node's own
    lightMap.channel = entry.texCoord;
    lightMap.repeat.fromArray(entry.scale);
    lightMap.offset.fromArray(entry.offset);
    for (const mesh of meshesOf(object, gltf.parser.associations)) {
      const key = [mesh.material.uuid, entry.file, entry.texCoord, entry.scale, entry.offset].join();
      if (!materials.has(key)) {
        const material = mesh.material.clone(); // nodes that share a material have lightmaps of their own
        material.lightMap = lightMap;
        material.lightMapIntensity = intensity;
        materials.set(key, material);
      }
      mesh.material = materials.get(key);
    }
  }
  let lights = 0;
  gltf.scene.traverse((object) => {
    if (!object.userData.kiln_baked || keepLights) return;
    for (const light of [object, ...object.children].filter((o) => o.isLight)) { light.visible = false; lights++; }
  });
  return { nodes: nodes.length, pages: pages.size, lights, unit: nodes[0][1].unit };
}
