/* A small scene with its surface and a synthetic result, for tests of output without importer, surface builder or
 * backend. Two objects share a mesh of two 1 m x 1 m squares that meet at x = 1 in space and lie apart, one turned by
 * 90 degrees, on the layout; the second object stands 3 m further up and is mirrored. All coverage is exact by
 * clipping. */
#ifndef KILN_TESTS_COMMON_SYNTHETIC_H
#define KILN_TESTS_COMMON_SYNTHETIC_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/job.h"
#include "coordinator/field/result.h"
#include "worker/base/memory.h"
#include "worker/scene/clip.h"

struct synthetic {
    struct kiln_scene_header header;
    struct kiln_material material;
    struct kiln_mesh mesh;
    struct kiln_object objects[2];
    struct kiln_environment environment;
    struct kiln_vec3 positions[8], normals[8];
    struct kiln_vec2 texcoords[8];
    uint8_t colors[8][4];
    uint32_t triangles[4][3], triangle_materials[4];
    struct kiln_scene scene;
    struct kiln_geometry *geometry;
    struct kiln_surface surface;
    float *direct, *indirect, *parts;
    uint16_t *error;
    uint64_t *radiosity;
    struct kiln_field_set fields; /* of a bake with an error map */
    struct kiln_rank_data data;
};

static const char synthetic_strings[] = "\0first\0second\0sheet\0grey";

static inline void synthetic_mesh(struct synthetic *s)
{
    static const float positions[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                          {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}};
    /* square 0 upright; square 1 turned: its left edge (x = 1) runs along u */
    static const float texcoords[8][2] = {{0.06f, 0.11f}, {0.41f, 0.11f}, {0.41f, 0.83f}, {0.06f, 0.83f},
                                          {0.93f, 0.17f}, {0.93f, 0.87f}, {0.55f, 0.87f}, {0.55f, 0.17f}};
    static const uint32_t triangles[4][3] = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
    for (int i = 0; i < 8; i++) {
        s->positions[i] = vec3(positions[i][0], positions[i][1], positions[i][2]);
        s->normals[i] = vec3(0, 0, 1);
        s->texcoords[i] = (struct kiln_vec2){texcoords[i][0], texcoords[i][1]};
        memset(s->colors[i], 255, 4);
    }
    memcpy(s->triangles, triangles, sizeof triangles);
    s->mesh = (struct kiln_mesh){.name = 14, .vertex_count = 8, .triangle_count = 4, .surface_area = 2.0};
}

static inline void synthetic_scene(struct synthetic *s, uint32_t width, uint32_t height)
{
    memset(s, 0, sizeof *s);
    synthetic_mesh(s);
    s->material = (struct kiln_material){.name = 20,
                                         .base_color = {0.5f, 0.5f, 0.5f, 1},
                                         .base_color_texture = KILN_NONE,
                                         .emission_texture = KILN_NONE};
    for (int i = 0; i < 2; i++) {
        s->objects[i] = (struct kiln_object){.name = i == 0 ? 1 : 7,
                                             .original_name = i == 0 ? 1 : 7,
                                             .lightmap_width = width,
                                             .lightmap_height = height,
                                             .transform = {i == 0 ? 1 : -1, 0, 0, 0, 0, 1, 0, i * 3.0, 0, 0, 1, 0},
                                             .flipped = (uint32_t)i};
    }
    s->objects[1].lightmap_height = height / 2 + 1;
    s->header.texels_per_metre = 10.0f;
    s->header.bounds_min[0] = -2;
    s->header.bounds_max[0] = 2;
    s->header.bounds_max[1] = 4;
    s->header.centre[1] = 2.0;
    s->scene = (struct kiln_scene){.header = &s->header,
                                   .strings = synthetic_strings,
                                   .materials = &s->material,
                                   .meshes = &s->mesh,
                                   .objects = s->objects,
                                   .environment = &s->environment,
                                   .positions = s->positions,
                                   .normals = s->normals,
                                   .texcoord_base = s->texcoords,
                                   .texcoord_emission = s->texcoords,
                                   .texcoord_lightmap = s->texcoords,
                                   .colors = &s->colors[0][0],
                                   .triangles = &s->triangles[0][0],
                                   .triangle_materials = s->triangle_materials,
                                   .material_count = 1,
                                   .mesh_count = 1,
                                   .object_count = 2,
                                   .vertex_count = 8,
                                   .triangle_count = 4,
                                   .descriptor = -1};
}

/* Area in texels of stored triangle `t` of object `o` in texel (x, y). */
static inline double synthetic_area(const struct synthetic *s, uint32_t o, uint32_t t, uint32_t x, uint32_t y)
{
    double corner[3][2];
    for (int c = 0; c < 3; c++) {
        corner[c][0] = (double)s->texcoords[s->triangles[t][c]].x * s->objects[o].lightmap_width - x;
        corner[c][1] = (double)s->texcoords[s->triangles[t][c]].y * s->objects[o].lightmap_height - y;
    }
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid;
    const uint32_t count = kiln_clip_triangle(corner, 0, 0, 1, 1, polygon);
    const double area = count < 3 ? 0.0 : kiln_clip_area(polygon, count, &centroid);
    return area > 1e-9 ? area : 0.0;
}

static inline void synthetic_point(struct synthetic *s, uint32_t o, uint32_t x, uint32_t y, uint64_t point,
                                   uint64_t *piece, uint64_t *share)
{
    struct kiln_surface *f = &s->surface;
    double total = 0.0, sum = 0.0;
    uint16_t count = 0;
    for (uint32_t t = 0; t < 4; t++)
        total += synthetic_area(s, o, t, x, y);
    for (uint32_t t = 0; t < 4; t++) {
        const double area = synthetic_area(s, o, t, x, y);
        if (!(area > 0.0))
            continue;
        sum += area;
        f->pieces[*piece + count] = (uint32_t)s->geometry->ranges[o].opaque_first + t;
        f->area_cdf[*share + count] = (float)(sum / total); /* the last is overwritten by the next point's */
        count++;
    }
    *piece += count;
    *share += count - 1u;
    f->piece_count[point] = (uint16_t)(count | (count == 1 && total > 0.999999 ? KILN_PIECES_WHOLE : 0u));
    const double per_texel = 1.0 / (0.37 * s->objects[o].lightmap_width * 0.71 * s->objects[o].lightmap_height);
    f->area[point] = (float)(total * per_texel);
    f->visible[point] = 0xffff;
    for (int c = 0; c < 3; c++)
        f->albedo[3 * point + (uint64_t)c] = 32768;
}

/* The tiles, and all points in order of object, tile and bit; every tile is one tile run, cells are objects. */
static inline void synthetic_surface(struct synthetic *s)
{
    struct kiln_surface *f = &s->surface;
    const size_t room = ((size_t)1 << 17) + 2 * ((size_t)s->objects[0].lightmap_width + 8) *
                                                (s->objects[0].lightmap_height + 8); /* points at most */
    (void)kiln_allocate(&f->tiles, room / 64, sizeof *f->tiles, "tiles", NULL);
    (void)kiln_allocate(&f->lightmaps, 2, sizeof *f->lightmaps, "lightmaps", NULL);
    (void)kiln_allocate(&f->tile_runs, room / 64, sizeof *f->tile_runs, "tile runs", NULL);
    (void)kiln_allocate(&f->piece_base, room / 64, sizeof(uint64_t), "pieces", NULL);
    (void)kiln_allocate(&f->area_cdf_base, room / 64, sizeof(uint64_t), "pieces", NULL);
    (void)kiln_allocate(&f->piece_count, room, sizeof(uint16_t), "pieces", NULL);
    (void)kiln_allocate(&f->pieces, 4 * room, sizeof(uint32_t), "pieces", NULL);
    (void)kiln_allocate(&f->area_cdf, 4 * room, sizeof(float), "pieces", NULL);
    (void)kiln_allocate(&f->albedo, 3 * room, sizeof(uint16_t), "albedo", NULL);
    (void)kiln_allocate(&f->area, room, sizeof(float), "area", NULL);
    (void)kiln_allocate(&f->visible, room, sizeof(uint16_t), "visible", NULL);
    (void)kiln_allocate(&f->cell_first, 3, sizeof(uint64_t), "cells", NULL);
    uint64_t piece = 0, share = 0;
    for (uint32_t o = 0; o < 2; o++) {
        const uint32_t width = s->objects[o].lightmap_width, height = s->objects[o].lightmap_height;
        f->lightmaps[o] = (struct kiln_lightmap){f->tile_count, width, height, (width + 7) / 8, (height + 7) / 8, 0, 1};
        f->object_count = f->whole_maps = f->map_count = 2;
        f->cell_first[o] = f->point_count;
        for (uint32_t tile = 0; tile < f->lightmaps[o].tiles_x * f->lightmaps[o].tiles_y; tile++, f->tile_count++) {
            struct kiln_tile_run tile_run = {.first = {f->point_count}, .map = o, .tile = tile, .cell = o};
            f->piece_base[f->tile_run_count] = piece;
            f->area_cdf_base[f->tile_run_count] = share;
            for (uint32_t bit = 0; bit < 64; bit++) {
                const uint32_t x = tile % f->lightmaps[o].tiles_x * 8 + kiln_morton8_x(bit);
                const uint32_t y = tile / f->lightmaps[o].tiles_x * 8 + kiln_morton8_y(bit);
                double area = 0.0;
                for (uint32_t t = 0; t < 4; t++)
                    area += synthetic_area(s, o, t, x, y);
                if (x >= width || y >= height || !(area > 0.0))
                    continue;
                synthetic_point(s, o, x, y, f->point_count, &piece, &share);
                tile_run.mask |= 1ull << bit;
                tile_run.count++;
                f->point_count++;
            }
            f->tiles[f->tile_count] = (struct kiln_tile){tile_run.mask, tile_run.first.at};
            if (tile_run.count > 0)
                f->tile_runs[f->tile_run_count++] = tile_run;
        }
    }
    f->piece_base[f->tile_run_count] = piece;
    f->area_cdf_base[f->tile_run_count] = share;
    f->cell_count = 2;
    f->cell_first[2] = f->point_count;
    f->count = f->point_count;
}

/* Leaves rank `rank` of `ranks` with its share of the tile runs; light is a smooth function of the texel's global index
 * and every 37th point is invalid. */
static inline void synthetic_share(struct synthetic *s, int rank, int ranks)
{
    struct kiln_surface *f = &s->surface;
    const size_t begin = f->tile_run_count * (size_t)rank / (size_t)ranks,
                 end = f->tile_run_count * (size_t)(rank + 1) / (size_t)ranks;
    const uint64_t first = begin < f->tile_run_count ? f->tile_runs[begin].first.at : f->point_count;
    const uint64_t last = end < f->tile_run_count ? f->tile_runs[end].first.at : f->point_count;
    (void)kiln_allocate(&s->direct, 3 * (last - first), sizeof(float), "light", NULL);
    (void)kiln_allocate(&s->indirect, 3 * (last - first), sizeof(float), "light", NULL);
    (void)kiln_allocate(&s->parts, KILN_PARTS * (last - first), sizeof(float), "parts", NULL);
    (void)kiln_allocate(&s->error, last - first, sizeof *s->error, "light", NULL);
    for (uint64_t p = first; p < last; p++) {
        for (uint64_t c = 0; c < 3; c++) {
            s->direct[3 * (p - first) + c] = 2.0f + sinf(0.01f * (float)(p * (c + 1)));
            s->indirect[3 * (p - first) + c] = 1.0f + 0.5f * cosf(0.02f * (float)(p + c));
        }
        s->error[p - first] = kiln_error_pack(0.01f);
        if (p % 37 == 5) {
            f->visible[p] = 0;
            s->direct[3 * (p - first)] = NAN; /* must never be looked at */
        }
    }
    f->tile_runs += begin;
    f->piece_base += begin;
    f->area_cdf_base += begin;
    f->tile_run_count = end - begin;
    f->piece_count += first;
    f->albedo += 3 * first;
    f->area += first;
    f->visible += first;
    f->first.at = first;
    f->count = last - first;
}

static inline struct kiln_bake_result synthetic_result(const struct synthetic *s, MPI_Comm communicator)
{
    return (struct kiln_bake_result){.units = kiln_units_of(KILN_UNITS_RADIOMETRIC, &s->scene),
                                     .communicator = communicator,
                                     .scene = &s->scene,
                                     .geometry = s->geometry,
                                     .surface = &s->surface,
                                     .fields = &s->fields,
                                     .data = &s->data,
                                     .radiosity = s->radiosity};
}

/* 0, or a status with its sentence. The arrays live until the process ends: their starts move with the share. */
static inline int synthetic_create(struct synthetic *s, uint32_t width, uint32_t height, int rank, int ranks,
                                   struct kiln_error *error)
{
    synthetic_scene(s, width, height);
    const int status = kiln_geometry_create(&s->geometry, &s->scene, error);
    if (status != KILN_OK)
        return status;
    synthetic_surface(s);
    synthetic_share(s, rank, ranks);
    kiln_field_set_choose(&s->fields, &(struct kiln_job){.lightmaps.error_map = true});
    s->data = (struct kiln_rank_data){.surface = s->surface,
                                      .direct = s->direct,
                                      .sum = s->indirect,
                                      .parts = s->parts,
                                      .error = s->error,
                                      .error_direct = s->error,
                                      .error_indirect = s->error};
    return kiln_allocate(&s->radiosity, s->surface.point_count, sizeof(uint64_t), "radiosity", error);
}

#endif
