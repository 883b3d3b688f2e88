/* Private header of the lightmap writer, shared by its source files. A file calls only files above it in this list:
 *
 *   maps.c            memory: opens maps, puts points into them, drops them
 *   run_maps.c        runs the stages of a map
 *   lightmap_image.c  turns a map into an image
 *   lightmap_file.c   names and describes the file of an image, and writes it
 *   rounds.c          the order of work: rounds, and which maps take all threads
 *   write_maps.c      writes the files of the maps of a round
 *   join_maps.c       solves the seams of objects that touch
 *   lightmaps.c       the entry point: the whole sequence */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_WRITE_WRITER_H
#define KILN_COORDINATOR_OUTPUT_MAP_WRITE_WRITER_H

#include "coordinator/files/publish.h"
#include "coordinator/output/exr.h"
#include "coordinator/output/image.h"
#include "coordinator/output/map/denoise/ghosts.h"
#include "coordinator/output/map/seams/joints.h"
#include "coordinator/output/map/stage.h"
#include "coordinator/output/map/write/texel_gather.h"

/* Writer of a bake's lightmaps. */
struct kiln_writer {
    const struct kiln_bake_result *result;
    const struct kiln_output_params *params;
    struct kiln_layers layers;
    struct kiln_lightmap_report *reports; /* reports of this rank's objects are filled in */
    struct kiln_publish_batch *batch;     /* finished files that have yet to be published */
    /* one for each lightmap; only those of this rank and round have a map, and those kept from joining to writing */
    struct kiln_map_work *works;
    struct kiln_joined *joined; /* NULL: no objects touch */
    struct kiln_ghosts *ghosts; /* if objects that touch are denoised */
    int ghost_status;           /* error of storing the ghosts that arrive */
    struct kiln_error ghost_error;
    struct kiln_bands *bands;
    struct kiln_chart_graphs *graphs;      /* of all maps */
    struct kiln_regression_device *device; /* device that denoises; NULL: none */
    double *denoising;                     /* seconds of denoising on this rank */
    bool keeps;                            /* maps of objects that touch stay in memory from joining to writing */
    uint32_t rank, ranks;
    int64_t seed;
    bool has_seed, has_caustics;
};

/* ---- the maps of a rank (maps.c) ---- */

/* Creates the map of an object, unless it exists, and fills in the work of its stages. */
int kiln_writer_open(const struct kiln_writer *writer, uint32_t object, struct kiln_error *error);

/* Puts a point into its map, or stores it as a ghost of another map; `context` is the writer. Thread-safe. */
void kiln_writer_put_point(void *context, const struct kiln_texel_record *record);

/* Whether all points of the object have arrived. */
int kiln_writer_check_arrived(const struct kiln_writer *writer, uint32_t object, struct kiln_error *error);

/* Releases a map and the data that its stages have made. */
void kiln_writer_drop(const struct kiln_writer *writer, uint32_t object);

/* ---- stages (run_maps.c) ---- */

/* Runs the first stages of an object's map, unless they have run: the map may have been kept. */
int kiln_writer_begin(const struct kiln_writer *writer, uint32_t object, struct kiln_error *error);

/* Turns gathered points into a map with a value in every texel. */
int kiln_writer_complete(const struct kiln_writer *writer, uint32_t object, struct kiln_error *error);

/* Returns the seconds of denoising not yet accounted for, and resets them. */
double kiln_writer_take_denoising(const struct kiln_writer *writer, uint32_t object);

/* Collective. Runs the first stages of a map in bands and solves its seams, unless the object touches others. */
int kiln_writer_solve_alone(const struct kiln_writer *writer, const struct kiln_assignment *assignment, uint32_t object,
                            struct kiln_error *error);

/* ---- images (lightmap_image.c) ---- */

/* Creates an image with the channels of the file from the planes of the map. */
int kiln_writer_image(const struct kiln_writer *writer, struct kiln_map *map, struct kiln_image **image,
                      struct kiln_error *error);

/* ---- files (lightmap_file.c) ---- */

enum { KILN_FILE_ATTRIBUTES = 15 }; /* attributes of every file; the last only if the seed is known */

/* Name of an object's file, and texts of its attributes. */
struct kiln_file_words {
    char name[KILN_PATH_SIZE], seed[32];
    struct kiln_exr_attribute attributes[KILN_FILE_ATTRIBUTES + KILN_FIELDS_ALWAYS];
    size_t count;
};

/* Fills in name and attributes of the file, and chooses the precision of the image's channels. Collective for
 * an object in bands. */
int kiln_writer_describe(const struct kiln_writer *writer, uint32_t object, struct kiln_image *image,
                         struct kiln_file_words *words, struct kiln_error *error);

/* Writes the files of one object: its lightmap, and the layers of groups if these have files of their own. */
int kiln_writer_put_files(const struct kiln_writer *writer, uint32_t object, struct kiln_image *image,
                          const struct kiln_file_words *words, struct kiln_error *error);

/* Number of layers of groups that have files of their own (field/group_fields.h). */
size_t kiln_writer_group_files(const struct kiln_writer *writer);

/* ---- rounds (rounds.c) ---- */

/* Total number of texels of some lightmaps. */
uint64_t kiln_writer_texels(const struct kiln_writer *writer, const uint32_t *own, size_t count);

/* Calls `run` for some objects of a round, the largest first. */
int kiln_writer_run_some(const struct kiln_writer *writer, const uint32_t *own, size_t count,
                         int (*run)(const struct kiln_writer *, uint32_t, struct kiln_error *),
                         struct kiln_error *error);

/* Collective. Calls `finish` with the objects of each round once their points and ghosts have arrived. Points of
 * lightmaps whose owner in `gathered` is KILN_NONE are not sent. */
int kiln_writer_walk_rounds(struct kiln_writer *writer, const struct kiln_assignment *assignment,
                            const struct kiln_assignment *gathered, const struct kiln_ghosts *ghosts,
                            int (*finish)(struct kiln_writer *, const struct kiln_assignment *, uint32_t round,
                                          uint32_t *own, size_t count, struct kiln_error *),
                            struct kiln_error *error);

/* ---- writing and joining the maps of a round (write_maps.c, join_maps.c) ---- */

/* Collective. Writes the objects of the round: each rank its small ones, then all ranks together the large ones. */
int kiln_writer_write(struct kiln_writer *writer, const struct kiln_assignment *assignment, uint32_t round,
                      uint32_t *own, size_t count, struct kiln_error *error);

/* Copies the assignment with only the lightmaps that have a joint (`joined`), or only those without. */
int kiln_writer_choose(struct kiln_assignment *chosen, const struct kiln_assignment *all,
                       const struct kiln_joints *joints, bool joined, struct kiln_error *error);

/* Collective. Solves the seams of objects that touch, and sets `joined` in the works of their maps. */
int kiln_writer_join(struct kiln_writer *writer, const struct kiln_assignment *assignment,
                     const struct kiln_joints *joints, struct kiln_error *error);

#endif
