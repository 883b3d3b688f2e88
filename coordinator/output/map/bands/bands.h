/* Bands: a large lightmap is worked on by all ranks together, each of which has a band of its rows. No rank has all of
 * it. Bands are whole strips of the file (exr_strips.h), from top to bottom in the order of ranks, as equal as they can
 * be; a rank may have none. A tile's rows are of one band.
 *
 * The arrays of such a map are as long as those of a whole one, so that a texel has the same index everywhere, but only
 * what is touched takes memory: own rows, up to KILN_BANDS_HALO rows of the bands above and below, and single texels
 * that were fetched. A stage (stage.h) works on the rows that the map has, and asks the other bands by the functions
 * below. Each is collective over the map's ranks if it is in bands, and does next to nothing for a whole map. So what
 * comes out does not depend on whether a map is in bands, nor on how many. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BANDS_BANDS_H
#define KILN_COORDINATOR_OUTPUT_MAP_BANDS_BANDS_H

#include <mpi.h>

#include "coordinator/output/map/map.h"

/* Ranks that work on maps in bands. */
struct kiln_bands {
    MPI_Comm comm, upward; /* comm is borrowed; upward: the same ranks in reverse order */
    uint32_t rank, ranks;
};

/* Collective. */
int kiln_bands_create(struct kiln_bands **bands, MPI_Comm communicator, struct kiln_error *error);
void kiln_bands_destroy(struct kiln_bands **bands);

/* The rows [*first, *end) of a rank's band in a map of so many rows, and the rank that has a row. */
void kiln_bands_rows(uint32_t height, uint32_t rank, uint32_t ranks, uint32_t *first, uint32_t *end);
uint32_t kiln_bands_rank(uint32_t height, uint32_t ranks, uint32_t row);

/* The map of this rank's band (kiln_map_create_rows). Not collective. */
int kiln_map_create_band(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                         const struct kiln_bands *bands, struct kiln_error *error);

/* The worst status of all ranks (mpi/agree.h). */
int kiln_bands_agree(const struct kiln_map *map, int status, struct kiln_error *error);

/* Sums `count` numbers of each row: first `rows`, those of the map's rows one after the other, in the order of rows,
 * over the whole map. */
int kiln_bands_sum(const struct kiln_map *map, const double *rows, size_t count, double *sums,
                   struct kiln_error *error);
/* The sums of numbers of all ranks, in place of them. */
int kiln_bands_count(const struct kiln_map *map, uint64_t *counts, size_t count, struct kiln_error *error);

/* The largest of each number of all ranks, in place of them. */
int kiln_bands_most(const struct kiln_map *map, double *numbers, size_t count, struct kiln_error *error);

/* The mean luminance of direct + indirect light over the surface texels of the whole lightmap; 0 without any. */
int kiln_map_mean_luminance(const struct kiln_map *map, double *mean, struct kiln_error *error);

/* Arrays that have an element a texel, or'ed. */
enum kiln_bands_array { KILN_BANDS_STATE = 1, KILN_BANDS_CHART = 2, KILN_BANDS_PLANES = 4 };

/* Brings `rows` rows (KILN_BANDS_HALO at most) above and below the band. */
int kiln_bands_halo(struct kiln_map *map, uint32_t arrays, uint32_t rows, struct kiln_error *error);
/* The same of another array of the map's texels, of `size` bytes each. */
int kiln_bands_halo_of(const struct kiln_map *map, void *array, size_t size, uint32_t rows, struct kiln_error *error);

/* Brings the planes and the chart of the texels that `nearest` gives for the map's texels, wherever they are. */
int kiln_bands_fetch(struct kiln_map *map, const uint32_t *nearest, struct kiln_error *error);

/* For each column the last row above the band and the first row below it of which `own` says so: `last` and `first`
 * are of the band itself, and become these. KILN_NONE: there is none. */
int kiln_bands_around(const struct kiln_map *map, uint32_t *last, uint32_t *first, struct kiln_error *error);

#endif
