/* Applies kiln's lightmaps to a scene that three.js has loaded from DIR/scene.glb.
 *
 *     const gltf = await new GLTFLoader().loadAsync('out/scene.glb');
 *     await applyKilnLightmaps(gltf, 'out/');
 *     scene.add(gltf.scene);
 *
 * What it does, and what any other loader must do, too:
 * - unit: three.js (r155 and later) takes a light map as irradiance E and shows albedo * E / pi, which is what kiln
 *   writes. So lightMapIntensity is 1, without a factor of pi; another value is an exposure. MeshStandardMaterial
 *   subtracts what its specular layer would reflect (4 % seen from above, more at a grazing angle), and an environment
 *   map adds it again; MeshLambertMaterial does not.
 * - rows: EXRLoader stores an EXR's bottom row first, at v = 0. In glTF v = 0 is the top row: flipY = true.
 * - UV set: TEXCOORD_1 is `uv1`: texture.channel = 1. Scale and offset go to texture.repeat and texture.offset.
 * - floats: EXRLoader makes half floats by default; the lux of a sunlit floor do not fit (65504 is the largest).
 * - channels: a bake's own EXRs hold direct and indirect light too, which EXRLoader of r155 cannot skip (r170 and r187
 *   can). For r155 write pages with RGB only: kiln export --atlas 4096.
 * - lights: those in the lightmaps (extras.kiln_baked) would light the scene twice. Switch them off, or leave them out
 *   of the file with kiln export --drop-baked-lights.
 */
import * as THREE from 'three';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';

/* Loads a page as a texture whose v = 0 is the page's top row. */
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

/* [object, its lightmap's entry] of every baked node. */
function bakedNodes(root) {
  const found = [];
  root.traverse((object) => {
    const entry = object.userData.kiln_lightmap ?? object.userData.gltfExtensions?.KILN_lightmap;
    if (entry?.instances !== undefined) {
      console.warn(`kiln: ${object.name} is drawn as instances with separate lightmaps: not supported by this recipe`);
    }
    if (entry?.file !== undefined) found.push([object, entry]);
  });
  return found;
}

/* The meshes of one node: itself, or the children that GLTFLoader made for its primitives. */
function meshesOf(object, associations) {
  const primitives = object.children.filter((child) => associations.get(child)?.nodes === undefined);
  return [...(object.isMesh ? [object] : []), ...primitives.flatMap((child) => meshesOf(child, associations))];
}

/* gltf: the result of GLTFLoader. base: URL of the folder of scene.glb, ending in '/'. Returns {nodes, pages, lights,
 * unit}: how many nodes got a lightmap, from how many images, how many lights were switched off, and the unit of the
 * lightmaps. */
export async function applyKilnLightmaps(gltf, base, options = {}) {
  const { intensity = 1, type = THREE.FloatType, keepLights = false } = options;
  const nodes = bakedNodes(gltf.scene), pages = new Map(), materials = new Map();
  if (nodes.length === 0) {
    throw new Error('no node of this scene has a lightmap: load the scene.glb that kiln wrote next to its lightmaps');
  }
  for (const [, entry] of nodes) {
    if (entry.encoding !== 'exr') {
      throw new Error(`the lightmaps are ${entry.encoding}: this recipe reads EXR (kiln export --format exr)`);
    }
    const url = new URL(entry.file, new URL(base, document.baseURI));
    if (!pages.has(entry.file)) pages.set(entry.file, loadPage(url, type));
  }
  for (const [object, entry] of nodes) {
    const lightMap = (await pages.get(entry.file)).clone(); // shares the image; repeat and offset are per node
    lightMap.channel = entry.texCoord;
    lightMap.repeat.fromArray(entry.scale);
    lightMap.offset.fromArray(entry.offset);
    for (const mesh of meshesOf(object, gltf.parser.associations)) {
      const key = [mesh.material.uuid, entry.file, entry.texCoord, entry.scale, entry.offset].join();
      if (!materials.has(key)) {
        const material = mesh.material.clone(); // nodes that share a material have separate lightmaps
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
    for (const light of [object, ...object.children].filter((o) => o.isLight)) {
      light.visible = false;
      lights++;
    }
  });
  return { nodes: nodes.length, pages: pages.size, lights, unit: nodes[0][1].unit };
}
