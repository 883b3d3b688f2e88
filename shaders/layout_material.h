/* Materials and textures on the device; part of shaders/layout.h. */

struct kiln_gpu_materials {
    KILN_ADDRESS materials, textures, texels, objects, meshes, stored_triangles, triangle_corners, texcoord_base, texcoord_emission, colors;
};
KILN_SIZE_IS(kiln_gpu_materials, 80);
