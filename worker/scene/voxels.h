/* Voxels: a grid over the scene with a bit for each cell that contains opaque, hittable surface (a filled cell), and a
 * visibility test for the line between two places (Kahl, "RTX Radiosity", 2023, section 5.3). Cells are cubes; their
 * number along the scene's longest side is given. A cell is filled if a triangle overlaps it (Akenine-Moller, "Fast 3D
 * Triangle-Box Overlap Testing", Journal of Graphics Tools 2001). A line goes from cell to cell (Amanatides and Woo, "A
 * Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987); The test ignores cells that touch the cell of
 * either end, or that the plane of the end's surface crosses, since they contain the surfaces of the ends. So objects
 * closer to a surface than a cell cast no shadow on it. */
#ifndef KILN_WORKER_SCENE_VOXELS_H
#define KILN_WORKER_SCENE_VOXELS_H

#include "worker/scene/geometry.h"

/* Largest number of cells along a side: 128 MiB of bits. */
enum { KILN_VOXELS_MOST = 1024 };

struct kiln_voxels;

/* `along` cells along the longest side, 1 to KILN_VOXELS_MOST. KILN_SYSTEM. */
int kiln_voxels_create(struct kiln_voxels **voxels, const struct kiln_geometry *geometry, uint32_t along,
                       struct kiln_error *error);
/* NULL is accepted. */
void kiln_voxels_destroy(struct kiln_voxels **voxels);
/* Upper bound of memory, bytes: the size for a cubic scene. */
uint64_t kiln_voxels_bytes(uint32_t along);

/* The grid: lowest corner, m from the scene's centre; side of a cell, m; number of cells along each axis; number of
 * filled cells. */
struct kiln_voxel_grid {
    struct kiln_dvec3 low;
    double side;
    int n[3];
    uint64_t filled;
};

struct kiln_voxel_grid kiln_voxels_grid(const struct kiln_voxels *voxels);

/* A cell by its coordinates, and the axis along which a line entered it. */
struct kiln_voxel {
    int cell[3], axis;
};

/* Finds the cell that contains a place (m from the scene's centre), or the nearest cell. Returns whether it is filled.
 * Thread-safe. */
bool kiln_voxels_at(const struct kiln_voxels *voxels, struct kiln_vec3 place, struct kiln_voxel *voxel);

/* Finds the first filled cell along a ray. Filled cells at its start are skipped until the ray has passed an empty
 * cell. False: none. Thread-safe. */
bool kiln_voxels_meet(const struct kiln_voxels *voxels, struct kiln_vec3 origin, struct kiln_vec3 direction,
                      struct kiln_voxel *met);

/* Whether no filled cell blocks the line between two places, m from the scene's centre, on surfaces with these normals.
 * Thread-safe. */
bool kiln_voxels_open(const struct kiln_voxels *voxels, struct kiln_vec3 from, struct kiln_vec3 from_normal,
                      struct kiln_vec3 to, struct kiln_vec3 to_normal);

/* Arrays of the voxels, for devices (described in shaders/shared/voxels.h). Borrowed. */
struct kiln_voxel_arrays {
    struct kiln_dvec3 low;
    double scale;
    int n[3];
    const uint32_t *words; /* a bit a cell */
    size_t word_count;
    uint64_t filled; /* cells */
};

struct kiln_voxel_arrays kiln_voxels_arrays(const struct kiln_voxels *voxels);

#endif
