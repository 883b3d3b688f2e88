/* A field is one quantity that a bake keeps for each item of a domain: irradiance for each surface point, seconds for
 * each tile run. All fields are rows of one table (fields.c), and all code that handles fields iterates over that
 * table:
 *
 *   memory of a rank and of its node, moving points between ranks      coordinator/field/rank_data.c
 *   checkpoints                                                        coordinator/field/field_blocks.c
 *   columns of kiln.h5                                                 coordinator/output/columns.c
 *   layers of the lightmaps                                            coordinator/output/map/layers.c
 *   ranges that `kiln verify` expects                                  coordinator/output/read/ranges.c
 *   memory and disk that `kiln plan` predicts                          coordinator/plan/plan.c
 *
 * A new quantity needs a new row, and the code that computes its values. If the `present` of a row returns false for a
 * job, the field is left out of the bake's field set, and costs no memory, no file space and no time. Nothing here is
 * collective. */
#ifndef KILN_COORDINATOR_FIELD_FIELD_H
#define KILN_COORDINATOR_FIELD_FIELD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/field/units.h"
#include "coordinator/job/job.h"
#include "worker/base/status.h"

/* Domains: kinds of items for which fields have values. Ranges of the global order are counted in each domain. */
enum kiln_domain { KILN_DOMAIN_TILE_RUN, KILN_DOMAIN_POINT, KILN_DOMAIN_PIECE, KILN_DOMAIN_AREA_CDF, KILN_DOMAINS };

/* Storage type of one component. The types of published fields are converted to floats: see kiln_field_floats. */
enum kiln_field_type {
    KILN_FIELD_FLOAT,
    KILN_FIELD_ERROR,     /* 16 bits: kiln_error_pack */
    KILN_FIELD_RADIOSITY, /* 64 bits, three values in one: kiln_radiosity_pack */
    KILN_FIELD_UNORM16,   /* 16 bits; 65535 is 1 */
    KILN_FIELD_UINT16,
    KILN_FIELD_UINT32,
    KILN_FIELD_UINT64,
    KILN_FIELD_TILE_RUN, /* struct kiln_tile_run */
    KILN_FIELD_QUEUE     /* struct kiln_work_queue */
};

/* Length of an array in items: one for each item of the domain; one more (where each item begins, and the end); or one
 * for the rank. Arrays of the last two lengths are rebuilt by the rank that has them, and never moved. */
enum kiln_field_length { KILN_FIELD_EACH, KILN_FIELD_ONE_MORE, KILN_FIELD_ONE };

/* Lifetime of a field, and the memory that it is in. */
enum kiln_field_life {
    KILN_FIELD_SURFACE,   /* lives as long as the surface points: made before light transport */
    KILN_FIELD_RESULT,    /* from the begin of light transport until all files are written; zero at first */
    KILN_FIELD_STEP,      /* scratch of a step: freed when light transport ends; zero after points were moved */
    KILN_FIELD_ALLGATHER, /* own part of the radiosity of all points; owned by radiosity_allgather.h */
    KILN_FIELD_SUM,       /* not stored: published as the sum of other fields */
    KILN_FIELD_LIVES
};

/* Which checkpoints hold a field's values. */
enum kiln_field_saved {
    KILN_FIELD_NOT_SAVED,
    KILN_FIELD_SAVED,          /* all */
    KILN_FIELD_SAVED_IN_STEP,  /* checkpoints that are written during a step */
    KILN_FIELD_SAVED_IN_GATHER /* checkpoints written during a step that gathers radiosity */
};

/* Maximum number of components of a published field: spherical harmonics of bands 0 and 1 have 12. */
enum { KILN_FIELD_COMPONENTS_MAX = 16 };
enum { KILN_FIELD_TERMS_ALWAYS = 2, KILN_FIELD_TERMS = 3 }; /* terms of a sum: minimum, maximum */

/* Meaning of the values. It determines how pictures show them and how texels are averaged. */
enum kiln_field_meaning {
    KILN_FIELD_AMOUNT,   /* of any magnitude: pictures choose the exposure */
    KILN_FIELD_FRACTION, /* 0 to 1: pictures show 1 as white */
    /* the first three components are a unit vector, world, or zero where there is none: means are brought to length 1,
     * and pictures show v / 2 + 1 / 2 */
    KILN_FIELD_DIRECTION,
    /* kinds that only views show (coordinator/view/show.h): linear colours, 0 to 1; positions in the world; numbers
     * without a colour of their own, shown on a false-colour scale */
    KILN_FIELD_COLOR,
    KILN_FIELD_PLACE,
    KILN_FIELD_SCALE
};

/* A row of the table. Strings and arrays are static. */
struct kiln_field {
    const char *name; /* also the name of its block in a checkpoint: shorter than KILN_ARRAY_NAME */
    const char *unit; /* "m2", "1", ...; NULL: the unit of the bake's light (coordinator/field/units.h) */
    bool is_radiance; /* with unit NULL: the unit is that of radiance; else of irradiance */
    enum kiln_field_meaning meaning;
    enum kiln_field_type type;
    uint32_t components; /* of an item */
    enum kiln_domain domain;
    enum kiln_field_length length;
    enum kiln_field_life life;
    /* offset in struct kiln_rank_data of the pointer to the values, for fields that code uses by name; 0: the pointer
     * is in the array `more` there */
    size_t member;
    /* KILN_FIELD_SUM: names of the terms, all in earlier rows: two fields, and a third that is added if the bake has
     * it, or NULL */
    const char *terms[KILN_FIELD_TERMS];
    enum kiln_field_saved saved;
    /* Finite values of published components lie in [low, high]: checked in checkpoints and by `kiln verify`. */
    double low, high;
    /* kiln.h5: the dataset's name, "/GROUP/NAME"; NULL: not in the file. The value is 0 at points where no light can be
     * gathered, unless the field describes the surface. */
    const char *dataset, *description;
    bool noisy;     /* low digits are random: as in kiln_chunk_pack */
    bool of_direct; /* final once all direct light has been computed */
    /* lightmaps: names of `components` channels; NULL: in no lightmap */
    const char *const *channels;
    const char *attribute; /* name of the attribute of lightmaps that holds `description`; NULL: none */
    bool smooth;           /* seams of charts and of objects that touch are smoothed */
    /* Whether a bake has the field, and whether its lightmaps do; NULL: always. */
    bool (*present)(const struct kiln_job *job);
    bool (*in_lightmaps)(const struct kiln_job *job);
};

/* All rows. */
const struct kiln_field *kiln_fields(size_t *count);

/* The unit of a field in a bake whose units of light are `units`. */
const char *kiln_field_unit(const struct kiln_field *field, const struct kiln_units *units);

/* Name of a published field for users and `kiln view --show`: the last part of its dataset's name ("direct"). NULL for
 * a field that is not published. */
const char *kiln_field_shown_name(const struct kiln_field *field);
/* The field with this user-visible name, if lightmaps may have it; else NULL. */
const struct kiln_field *kiln_field_shown(const char *name);

/* Name of the field with the samples of each tile run in a step with adaptive samples. */
#define KILN_FIELD_SAMPLES "samples"
/* Name of the field with the samples of late bounces. */
#define KILN_FIELD_SAMPLES_BOUNCE "samples_bounce"
/* Name of the field with the samples of direct light, in a bake with a target error. */
#define KILN_FIELD_SAMPLES_DIRECT "samples_direct"
/* Name of the field with the samples that tile runs have had in rounds. */
#define KILN_FIELD_SAMPLES_TAKEN "samples_taken"

enum { KILN_FIELDS_ALWAYS = 45, KILN_FIELDS_MAX = KILN_FIELDS_ALWAYS + 4 * KILN_GROUPS_MAX }; /* a group has four */

/* The fields that one bake has, in the table's order. */
struct kiln_field_set {
    size_t count;
    struct kiln_field_entry {
        const struct kiln_field *field;
        bool in_lightmaps;
        size_t terms[KILN_FIELD_TERMS], term_count; /* KILN_FIELD_SUM: indices of the terms in this set */
    } entry[KILN_FIELDS_MAX];
};

/* Fills the set with the fields of the table that the job needs. */
void kiln_field_set_choose(struct kiln_field_set *set, const struct kiln_job *job);
/* Adds one row, borrowed. KILN_BUG, with a sentence, if the set is full, has a field of that name, or does not contain
 * a term of the sum. */
int kiln_field_set_add(struct kiln_field_set *set, const struct kiln_field *field, bool in_lightmaps,
                       struct kiln_error *error);
/* The place of the field of that name; set->count when there is none. */
size_t kiln_field_set_find(const struct kiln_field_set *set, const char *name);

/* Bytes of one item's values. */
size_t kiln_field_size(const struct kiln_field *field);
/* Number of items in a rank's array of the field; `items`: the rank's number of items of each domain. */
uint64_t kiln_field_count(const struct kiln_field *field, const uint64_t items[KILN_DOMAINS]);
/* Bytes of all fields with this lifetime on a rank; `items`: the rank's number of items of each domain. */
uint64_t kiln_field_set_bytes(const struct kiln_field_set *set, enum kiln_field_life life,
                              const uint64_t items[KILN_DOMAINS]);
/* Bytes of one surface point: in the fields with this lifetime; in a checkpoint at most. */
uint64_t kiln_field_set_point_bytes(const struct kiln_field_set *set, enum kiln_field_life life);
uint64_t kiln_field_set_saved_bytes(const struct kiln_field_set *set);
/* Bytes that light transport allocates on a node with one rank that owns `own` of `total` surface points, for all data
 * of a point other than its surface. */
uint64_t kiln_field_set_light_bytes(const struct kiln_field_set *set, uint64_t own, uint64_t total);

/* Sizes of published fields: floats of a texel in a lightmap file; bytes of a texel while a lightmap is made, with all
 * fields that have channels; bytes of a point in kiln.h5. */
uint32_t kiln_field_set_channels(const struct kiln_field_set *set);
uint64_t kiln_field_set_plane_bytes(const struct kiln_field_set *set);
uint64_t kiln_field_set_column_bytes(const struct kiln_field_set *set);

/* Converts the components of `items` items from number `first` on to published form: floats in the field's unit.
 * `values` is the field's array. Non-numeric types (tile runs, queues) have no published form. */
void kiln_field_floats(const struct kiln_field *field, const void *values, uint64_t first, uint64_t items,
                       float *floats);
/* Whether the values of `count` items are plausible for a bake: finite, and within the field's range from `low` to
 * `high`. Of the integer types, only 32-bit integers are checked. */
bool kiln_field_is_sane(const struct kiln_field *field, const void *values, uint64_t count);

#endif
