/* The scattering function at a position of a surface whose material is simulated with its gloss
 * (kiln_scene_take_gloss). Pure functions, thread-safe. */
#ifndef KILN_WORKER_MATERIAL_SURFACE_BSDF_H
#define KILN_WORKER_MATERIAL_SURFACE_BSDF_H

#include "shaders/shared/bsdf.h"
#include "worker/scene/gloss.h"

/* Indices of refraction of the gloss for red, green and blue; 0, which stands for total reflection, is replaced by a
 * large number. */
struct kiln_vec3 kiln_gloss_index(const struct kiln_gloss *gloss);

/* The material at a position: factors, vertex colours and textures multiplied. `triangle` is an index into the scene's
 * stored triangles and must belong to `mesh`; b1 and b2 are the barycentric weights of its corners 1 and 2. */
struct kiln_bsdf kiln_surface_bsdf(const struct kiln_scene *scene, const struct kiln_gloss *gloss,
                                   const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2);

/* The material of a gloss without textures, for a given base colour. */
struct kiln_bsdf kiln_gloss_bsdf(const struct kiln_gloss *gloss, const float base[3]);

/* The lobes of a material that is taken with its gloss, computed once for its whole surface if possible. */
struct kiln_gloss_lobes {
    bool ready; /* `lobes` hold all over, but for the colour; false: unset */
    bool dyed;  /* the base colour varies over the surface (kiln_bsdf_dye) */
    struct kiln_bsdf_lobes lobes;
    struct kiln_bsdf_tables tables; /* used by lobes computed at a hit, if not ready */
};
/* Computes a material's lobes, without tables. Not `ready` if the material is not taken with its gloss. */
struct kiln_gloss_lobes kiln_gloss_lobes(const struct kiln_scene *scene, uint32_t material);
/* The lobes at a position, arguments as kiln_surface_bsdf; `of`: the lobes of its material, which is taken with its
 * gloss. `colored`: compute the colour of the diffuse part, too; else it is undefined. */
struct kiln_bsdf_lobes kiln_surface_lobes(const struct kiln_scene *scene, const struct kiln_gloss_lobes *of,
                                          const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                                          bool colored);

/* Diffuse albedo of a position (linear RGB, 0..1), arguments as above. With gloss it is the albedo of the diffuse part
 * (kiln_diffuse_color), else the colour of kiln_surface_color. */
void kiln_surface_albedo(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                         float b2, float rgb[3]);

/* Orthonormal frame in which the scattering function takes directions. */
struct kiln_frame {
    struct kiln_vec3 x, y, z;
};
/* Returns a frame about z, the shading normal of the front. x is arbitrary: for isotropic materials. */
struct kiln_frame kiln_frame_about(struct kiln_vec3 z);
static inline struct kiln_vec3 kiln_into_frame(const struct kiln_frame *frame, struct kiln_vec3 d)
{
    return vec3(vec3_dot(frame->x, d), vec3_dot(frame->y, d), vec3_dot(frame->z, d));
}
static inline struct kiln_vec3 kiln_out_of_frame(const struct kiln_frame *frame, struct kiln_vec3 d)
{
    return vec3_madd(vec3_madd(vec3_scale(frame->x, d.x), frame->y, d.y), frame->z, d.z);
}
/* The frame at a world position of a mesh: x is the direction along which anisotropic highlights are stretched.
 * `edge[0..1]`: the world triangle's edges from corner 0 to 1 and to 2, m, corners in stored order. */
struct kiln_frame kiln_surface_frame(const struct kiln_scene *scene, const struct kiln_gloss *gloss,
                                     const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                                     struct kiln_vec3 z, const struct kiln_vec3 edge[2]);

/* Transmittance, by colour, over `distance` m in the body that a face of the material bounds (Beer's law). */
void kiln_gloss_attenuation(const struct kiln_gloss *gloss, float distance, float share[3]);

#endif
