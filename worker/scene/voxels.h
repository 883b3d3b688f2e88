/* Voxels: which cells of a grid over the scene have any of its opaque surface that rays can meet, and whether a line
 * between two places goes by cells without (Kahl, "RTX Radiosity", 2023, section 5.3). Cells are cubes, as many along
 * the scene's longest side as is asked for; a cell counts if a triangle comes into it (Akenine-Moller, "Fast 3D
 * Triangle-Box Overlap Testing", Journal of Graphics Tools 2001). A line goes from cell to cell (Amanatides and Woo, "A
 * Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987); those do not count that touch the cell of
 * either end, or that the plane of its surface goes through: the surfaces of the ends are in them. So what is nearer to
 * a surface than a cell casts no shadow on it. */
#ifndef KILN_WORKER_SCENE_VOXELS_H
#define KILN_WORKER_SCENE_VOXELS_H

#include "worker/scene/geometry.h"

/* Along a side: 128 MiB of bits. */
enum { KILN_VOXELS_MOST = 1024 };

struct kiln_voxels;

/* `along` cells along the longest side, 1 to KILN_VOXELS_MOST. KILN_SYSTEM. */
int kiln_voxels_create(struct kiln_voxels **voxels, const struct kiln_geometry *geometry, uint32_t along,
                       struct kiln_error *error);
/* NULL is accepted. */
void kiln_voxels_destroy(struct kiln_voxels **voxels);
/* Bytes of memory at most: those for a scene that is a cube. */
uint64_t kiln_voxels_bytes(uint32_t along);

/* The grid: its corner, m from the scene's centre; the side of a cell, m; cells along each axis, and how many count. */
struct kiln_voxel_grid {
    struct kiln_dvec3 low;
    double side;
    int n[3];
    uint64_t filled;
};

struct kiln_voxel_grid kiln_voxels_grid(const struct kiln_voxels *voxels);

/* A cell by its numbers along the axes; and across which axis a line has come into it. */
struct kiln_voxel {
    int cell[3], axis;
};

/* The cell that a place lies in, m from the scene's centre, or is nearest to; whether it counts. Thread-safe. */
bool kiln_voxels_at(const struct kiln_voxels *voxels, struct kiln_vec3 place, struct kiln_voxel *voxel);

/* The first cell that counts on the way of a ray; of those that it begins in none does until one has been empty. False:
 * there is none. Thread-safe. */
bool kiln_voxels_meet(const struct kiln_voxels *voxels, struct kiln_vec3 origin, struct kiln_vec3 direction,
                      struct kiln_voxel *met);

/* Whether no cell lies between two places, m from the scene's centre, on surfaces with these normals. Thread-safe. */
bool kiln_voxels_open(const struct kiln_voxels *voxels, struct kiln_vec3 from, struct kiln_vec3 from_normal,
                      struct kiln_vec3 to, struct kiln_vec3 to_normal);

/* Arrays of the voxels, for devices (shaders/shared/voxels.h says what they are). Borrowed. */
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
