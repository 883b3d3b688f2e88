/* Results of a bake when light transport is done and files are to be written. */
#ifndef KILN_COORDINATOR_FIELD_RESULT_H
#define KILN_COORDINATOR_FIELD_RESULT_H

#include <mpi.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/field/rank_data.h"
#include "coordinator/field/units.h"
#include "worker/backend/backend.h"
#include "worker/pass/probes.h"

/* All arrays are of this rank's own points (surface->count, in global order from surface->first); irradiance is in
 * units->irradiance. */
struct kiln_bake_result {
    const struct kiln_units *units;
    MPI_Comm communicator; /* one-sided calls are not used; every rank takes part in every output call */
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_surface *surface;
    /* what was computed of the own points: read with kiln_rank_field and kiln_rank_floats */
    const struct kiln_field_set *fields;
    const struct kiln_rank_data *data;
    const uint64_t *radiosity; /* all points: packed total radiosity (albedo x irradiance), for views and probes */
    /* of the visibility grid (integrate/reach/sight.h): its units, 0: there is none; pairs of the own ones */
    uint64_t sight_units, sight_pair_count;
    const uint64_t *sight_first, *sight_pairs;
    const struct kiln_stop *stop; /* what asks to end before all files are written; NULL: nothing does */
};

/* Surfaces around a probe: plane g of direction i = (dx + 1) + 3 (dy + 1) + 9 (dz + 1), dx dy dz of -1 0 1, is that of
 * the first surface which the ray in this direction meets. A place v, m from the probe, lies behind it where g . v > 1:
 * g is the plane's unit normal, which leads away from the probe, divided by the plane's distance, 1/m. It is 0 where
 * nothing is met, and in the middle (i = 13), which is no direction. */
enum { KILN_OCCLUDER_DIRECTIONS = 27 };
#define KILN_OCCLUDER_NEAREST 1e-6 /* of the scene's diagonal: planes count as so far away at least */
struct kiln_probe_occluders {
    float planes[KILN_OCCLUDER_DIRECTIONS][3];
};

/* State of a probe, by where its light is from. */
enum kiln_probe_state {
    KILN_PROBE_IN_PLACE, /* its light is that of its place in the grid */
    KILN_PROBE_MOVED,    /* that place lies inside geometry: its light is that of a place beside it, outside */
    KILN_PROBE_FILLED,   /* there is no such place in reach: its light is a mean of that of other probes near it */
    KILN_PROBE_BURIED,   /* nor are there such probes */
    KILN_PROBE_STATES
};

/* Where a probe's light was gathered: its place in the grid + offset, m. */
struct kiln_probe_place {
    float offset[3];
    uint32_t state; /* enum kiln_probe_state */
};

/* Bytes of a probe in memory. */
#define KILN_PROBE_BYTES                                                                                               \
    (sizeof(struct kiln_probe_result) + sizeof(struct kiln_probe_occluders) + sizeof(struct kiln_probe_place))

/* The light of a group of lights at a probe, as struct kiln_probe_result has it of all. */
struct kiln_probe_group {
    float radiance[9][3], irradiance_axes[6][3];
};

/* The irradiance volume: a regular grid of probes, this rank's share of them a contiguous range of z-major order
 * (index = (z * size[1] + y) * size[0] + x). */
struct kiln_volume_result {
    uint64_t size[3];
    double origin[3];  /* world, m: position of probe (0,0,0) */
    double spacing[3]; /* m */
    /* sources of light around what receives it that the grid does not span (bake/volume/volume_bounds.h), and the
     * object that is the largest of them */
    uint64_t sources_left_out;
    uint32_t largest_left_out;
    uint64_t first, count;
    const struct kiln_probe_result *probes; /* own */
    bool of_irradiance; /* their coefficients are of irradiance: the cosine is in them already (of mixtures) */
    const struct kiln_probe_occluders *occluders; /* own */
    const struct kiln_probe_place *places;        /* own */
    /* of each own probe what each of `group_count` groups of lights brings (worker/pass/groups.h), whose names are
     * borrowed; NULL: they are not told apart */
    const struct kiln_probe_group *groups;
    size_t group_count;
    char *const *group_names;
    /* light paths that this rank has traced for probes (bake/volume/probe_paths.h), and those that Embree traced for a
     * device
     */
    uint64_t paths, paths_on_host;
};

#endif
