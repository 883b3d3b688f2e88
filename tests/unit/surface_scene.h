/* Builder of small scenes in memory, for tests of geometry, surface and footprints. */
#ifndef KILN_TESTS_UNIT_SURFACE_SCENE_H
#define KILN_TESTS_UNIT_SURFACE_SCENE_H

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "worker/scene/scene.h"

enum { FIXTURE_VERTICES = 1 << 18, FIXTURE_TRIANGLES = 1 << 18, FIXTURE_OBJECTS = 512, FIXTURE_MATERIALS = 16 };

struct fixture {
    struct kiln_scene scene;
    struct kiln_scene_header header;
    struct kiln_material materials[FIXTURE_MATERIALS];
    struct kiln_texture textures[4];
    uint8_t texels[4096];
    struct kiln_mesh meshes[FIXTURE_OBJECTS];
    struct kiln_object objects[FIXTURE_OBJECTS];
    struct kiln_environment environment;
    struct kiln_vec3 *positions, *normals;
    struct kiln_vec2 *base, *emission, *lightmap;
    uint8_t *colors;
    uint32_t *triangles, *triangle_materials;
    uint64_t texel_bytes, random;
};

static inline struct fixture *fixture_create(void)
{
    struct fixture *f = calloc(1, sizeof *f);
    f->positions = calloc(FIXTURE_VERTICES, sizeof *f->positions);
    f->normals = calloc(FIXTURE_VERTICES, sizeof *f->normals);
    f->base = calloc(FIXTURE_VERTICES, sizeof *f->base);
    f->emission = calloc(FIXTURE_VERTICES, sizeof *f->emission);
    f->lightmap = calloc(FIXTURE_VERTICES, sizeof *f->lightmap);
    f->colors = malloc(4 * FIXTURE_VERTICES);
    memset(f->colors, 255, 4 * FIXTURE_VERTICES);
    f->triangles = calloc(3 * FIXTURE_TRIANGLES, sizeof *f->triangles);
    f->triangle_materials = calloc(FIXTURE_TRIANGLES, sizeof *f->triangle_materials);
    f->scene = (struct kiln_scene){.header = &f->header,
                                   .strings = "thing",
                                   .materials = f->materials,
                                   .textures = f->textures,
                                   .texels = f->texels,
                                   .meshes = f->meshes,
                                   .objects = f->objects,
                                   .environment = &f->environment,
                                   .positions = f->positions,
                                   .normals = f->normals,
                                   .texcoord_base = f->base,
                                   .texcoord_emission = f->emission,
                                   .texcoord_lightmap = f->lightmap,
                                   .colors = f->colors,
                                   .triangles = f->triangles,
                                   .triangle_materials = f->triangle_materials};
    f->random = 1;
    return f;
}

static inline void fixture_destroy(struct fixture *f)
{
    free(f->positions);
    free(f->normals);
    free(f->base);
    free(f->emission);
    free(f->lightmap);
    free(f->colors);
    free(f->triangles);
    free(f->triangle_materials);
    free(f);
}

static inline double fixture_random(struct fixture *f)
{
    f->random = f->random * 6364136223846793005u + 1442695040888963407u;
    return (double)(f->random >> 11) * 0x1p-53;
}

static inline uint32_t fixture_material(struct fixture *f, float red, float green, float blue)
{
    assert(f->scene.material_count < FIXTURE_MATERIALS);
    f->materials[f->scene.material_count] = (struct kiln_material){
        .base_color = {red, green, blue, 1.0f}, .base_color_texture = KILN_NONE, .emission_texture = KILN_NONE};
    return (uint32_t)f->scene.material_count++;
}

/* A texture of w x h texels, nearest filter, filled by the caller through the pointer. */
static inline uint8_t *fixture_texture(struct fixture *f, uint32_t w, uint32_t h, uint32_t *index)
{
    uint8_t *texels = f->texels + f->texel_bytes;
    *index = (uint32_t)f->scene.texture_count++;
    f->textures[*index] = (struct kiln_texture){.first = f->texel_bytes, .width = w, .height = h, .nearest = 1};
    f->texel_bytes += 4 * (uint64_t)w * h;
    assert(f->texel_bytes <= sizeof f->texels);
    return texels;
}

static inline uint32_t fixture_mesh(struct fixture *f)
{
    assert(f->scene.mesh_count < FIXTURE_OBJECTS);
    f->meshes[f->scene.mesh_count] =
        (struct kiln_mesh){.vertex_first = f->scene.vertex_count, .triangle_first = f->scene.triangle_count};
    return (uint32_t)f->scene.mesh_count++;
}

/* Adds to the mesh begun last; gives the index within the mesh. */
static inline uint32_t fixture_vertex(struct fixture *f, double x, double y, double z, double u, double v)
{
    struct kiln_mesh *mesh = &f->meshes[f->scene.mesh_count - 1];
    const size_t i = f->scene.vertex_count++;
    assert(i < FIXTURE_VERTICES);
    f->positions[i] = vec3((float)x, (float)y, (float)z);
    f->normals[i] = vec3(0.0f, 0.0f, 1.0f);
    f->lightmap[i] = (struct kiln_vec2){(float)u, (float)v};
    f->base[i] = f->lightmap[i];
    return (uint32_t)mesh->vertex_count++;
}

static inline void fixture_triangle(struct fixture *f, uint32_t a, uint32_t b, uint32_t c, uint32_t material)
{
    const size_t i = f->scene.triangle_count++;
    assert(i < FIXTURE_TRIANGLES);
    f->triangles[3 * i] = a;
    f->triangles[3 * i + 1] = b;
    f->triangles[3 * i + 2] = c;
    f->triangle_materials[i] = material;
    f->meshes[f->scene.mesh_count - 1].triangle_count++;
}

/* A sheet of n x n squares, each two triangles, with corner o and sides a and b, front along a x b, laid out on [u0,u1]
 * x [v0,v1]; inner vertices moved about within the sheet and its layout by `disorder` of a square. */
static inline void fixture_sheet(struct fixture *f, struct kiln_dvec3 o, struct kiln_dvec3 a, struct kiln_dvec3 b,
                                 uint32_t n, const double uv[4], double disorder, uint32_t material)
{
    const uint32_t first = (uint32_t)f->meshes[f->scene.mesh_count - 1].vertex_count;
    for (uint32_t j = 0; j <= n; j++) {
        for (uint32_t i = 0; i <= n; i++) {
            const int inner = i > 0 && j > 0 && i < n && j < n;
            double s[2], t[2];
            for (int k = 0; k < 2; k++) {
                s[k] = (i + (inner ? disorder * (fixture_random(f) - 0.5) : 0.0)) / n;
                t[k] = (j + (inner ? disorder * (fixture_random(f) - 0.5) : 0.0)) / n;
            }
            const struct kiln_dvec3 p = dvec3_add(o, dvec3_add(dvec3_scale(a, s[0]), dvec3_scale(b, t[0])));
            fixture_vertex(f, p.x, p.y, p.z, uv[0] + (uv[1] - uv[0]) * s[1], uv[2] + (uv[3] - uv[2]) * t[1]);
        }
    }
    for (uint32_t j = 0; j < n; j++) {
        for (uint32_t i = 0; i < n; i++) {
            const uint32_t c = first + j * (n + 1) + i;
            fixture_triangle(f, c, c + 1, c + n + 2, material);
            fixture_triangle(f, c, c + n + 2, c + n + 1, material);
        }
    }
}

/* The six sides of the cube -1..1, fronts outside, charts with a margin on a 3 x 2 raster of the layout. */
static inline uint32_t fixture_cube(struct fixture *f, uint32_t n, double disorder, uint32_t material)
{
    static const double o[6][3] = {{1, -1, 1}, {-1, -1, -1}, {-1, 1, 1}, {-1, -1, -1}, {-1, -1, 1}, {1, -1, -1}};
    static const double a[6][3] = {{0, 0, -2}, {0, 0, 2}, {2, 0, 0}, {2, 0, 0}, {2, 0, 0}, {-2, 0, 0}};
    static const double b[6][3] = {{0, 2, 0}, {0, 2, 0}, {0, 0, -2}, {0, 0, 2}, {0, 2, 0}, {0, 2, 0}};
    const uint32_t mesh = fixture_mesh(f);
    for (int side = 0; side < 6; side++) {
        const double u = side % 3 / 3.0, v = side / 3 / 2.0;
        const double uv[4] = {u + 0.021, u + 0.312, v + 0.023, v + 0.477};
        fixture_sheet(f, dvec3(o[side][0], o[side][1], o[side][2]), dvec3(a[side][0], a[side][1], a[side][2]),
                      dvec3(b[side][0], b[side][1], b[side][2]), n, uv, disorder, material);
    }
    return mesh;
}

/* Rows of a 3 x 4 transform; the identity where NULL. */
static inline uint32_t fixture_object(struct fixture *f, uint32_t mesh, const double transform[12], uint32_t width,
                                      uint32_t height)
{
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    assert(f->scene.object_count < FIXTURE_OBJECTS);
    struct kiln_object *object = &f->objects[f->scene.object_count];
    *object = (struct kiln_object){.mesh = mesh, .lightmap_width = width, .lightmap_height = height};
    memcpy(object->transform, transform != NULL ? transform : identity, sizeof object->transform);
    const double *m = object->transform;
    const double determinant =
        m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) + m[2] * (m[4] * m[9] - m[5] * m[8]);
    object->flipped = determinant < 0.0;
    return (uint32_t)f->scene.object_count++;
}

#endif
