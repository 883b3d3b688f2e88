/* Bands: a large lightmap is processed by all ranks together, each of which has a band of its rows; no rank has the
 * whole map. Bands are whole strips of the file (exr_strips.h), from top to bottom in the order of ranks, of nearly
 * equal size; a rank may have none. A tile's rows are in one band.
 *
 * The arrays of such a map are as long as those of a whole one, so that a texel has the same index on all ranks. But
 * only pages that are touched take memory: own rows, up to KILN_BANDS_HALO rows of the bands above and below, and
 * fetched single texels. A stage (stage.h) processes the map's rows, and gets data of other bands by the functions
 * below. Each is collective over the map's ranks if the map is in bands, and nearly free for a whole map. So results
 * depend neither on bands nor on their number. */
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

/* kiln_bands_rows: the rows [*first, *end) of a rank's band in a map with `height` rows. kiln_bands_rank: the rank that
 * has a row. */
void kiln_bands_rows(uint32_t height, uint32_t rank, uint32_t ranks, uint32_t *first, uint32_t *end);
uint32_t kiln_bands_rank(uint32_t height, uint32_t ranks, uint32_t row);

/* Creates the map of this rank's band (kiln_map_create_rows). Not collective. */
int kiln_map_create_band(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                         const struct kiln_bands *bands, struct kiln_error *error);

/* Returns the worst status of all ranks (mpi/agree.h). */
int kiln_bands_agree(const struct kiln_map *map, int status, struct kiln_error *error);

/* Sums `count` numbers per row over the whole map, in the order of rows. `rows` has those of this map's rows, row after
 * row. */
int kiln_bands_sum(const struct kiln_map *map, const double *rows, size_t count, double *sums,
                   struct kiln_error *error);
/* Replaces each count by its sum over all ranks. */
int kiln_bands_count(const struct kiln_map *map, uint64_t *counts, size_t count, struct kiln_error *error);

/* Replaces each number by its maximum over all ranks. */
int kiln_bands_most(const struct kiln_map *map, double *numbers, size_t count, struct kiln_error *error);

/* The mean luminance of direct + indirect light over the surface texels of the whole lightmap; 0 without any. */
int kiln_map_mean_luminance(const struct kiln_map *map, double *mean, struct kiln_error *error);

/* Arrays with an element per texel; bit flags. */
enum kiln_bands_array { KILN_BANDS_STATE = 1, KILN_BANDS_CHART = 2, KILN_BANDS_PLANES = 4 };

/* Fetches `rows` rows (KILN_BANDS_HALO at most) above and below the band. */
int kiln_bands_halo(struct kiln_map *map, uint32_t arrays, uint32_t rows, struct kiln_error *error);
/* Likewise for another array of the map's texels, of `size` bytes each. */
int kiln_bands_halo_of(const struct kiln_map *map, void *array, size_t size, uint32_t rows, struct kiln_error *error);

/* Fetches planes and chart of the texels that `nearest` gives for the map's texels, from any band. */
int kiln_bands_fetch(struct kiln_map *map, const uint32_t *nearest, struct kiln_error *error);

/* Finds for each column the last row above the band and the first row below it that are marked. On entry `last` and
 * `first` are the marked rows within the band itself; on return those above and below. KILN_NONE: there is none. */
int kiln_bands_around(const struct kiln_map *map, uint32_t *last, uint32_t *first, struct kiln_error *error);

#endif
