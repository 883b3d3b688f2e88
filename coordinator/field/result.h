/* Results of a bake after light transport, before the files are written. */
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
    /* computed data of the own points: read with kiln_rank_field and kiln_rank_floats */
    const struct kiln_field_set *fields;
    const struct kiln_rank_data *data;
    const uint64_t *radiosity; /* all points: packed total radiosity (albedo x irradiance), for views and probes */
    /* visibility grid (integrate/reach/sight.h): number of units, 0: there is none; number of pairs of the own units */
    uint64_t sight_units, sight_pair_count;
    const uint64_t *sight_first, *sight_pairs;
    const struct kiln_stop *stop; /* may ask to end before all files are written; NULL: nothing does */
};

/* Surfaces around a probe. Plane g of direction i = (dx + 1) + 3 (dy + 1) + 9 (dz + 1), where dx, dy, dz are -1, 0 or
 * 1, is the plane of the first surface that the ray in this direction hits. A place v, m from the probe, lies behind it
 * if g . v > 1: g is the plane's unit normal, pointing away from the probe, divided by the plane's distance, 1/m. g is
 * 0 if the ray hits nothing, and in the middle (i = 13), which is no direction. */
enum { KILN_OCCLUDER_DIRECTIONS = 27 };
#define KILN_OCCLUDER_NEAREST 1e-6 /* of the scene's diagonal: minimum distance of a plane */
struct kiln_probe_occluders {
    float planes[KILN_OCCLUDER_DIRECTIONS][3];
};

/* State of a probe: the source of its light. */
enum kiln_probe_state {
    KILN_PROBE_IN_PLACE, /* light gathered at its place in the grid */
    KILN_PROBE_MOVED,    /* that place lies inside geometry: light gathered at a place beside it, outside */
    KILN_PROBE_FILLED,   /* there is no such place in reach: mean light of other probes near it */
    KILN_PROBE_BURIED,   /* there are no such probes either: no light */
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

/* Light of one group of lights at a probe, in the form of struct kiln_probe_result. */
struct kiln_probe_group {
    float radiance[9][3], irradiance_axes[6][3];
};

/* The irradiance volume: a regular grid of probes, this rank's share of them a contiguous range of z-major order
 * (index = (z * size[1] + y) * size[0] + x). */
struct kiln_volume_result {
    uint64_t size[3];
    double origin[3];  /* world, m: position of probe (0,0,0) */
    double spacing[3]; /* m */
    /* number of sources around the receivers of light that the grid does not span (bake/volume/volume_bounds.h), and
     * the largest such object */
    uint64_t sources_left_out;
    uint32_t largest_left_out;
    uint64_t first, count;
    const struct kiln_probe_result *probes; /* own */
    bool of_irradiance; /* probe coefficients are of irradiance: they already include the cosine (of mixtures) */
    const struct kiln_probe_occluders *occluders; /* own */
    const struct kiln_probe_place *places;        /* own */
    /* light of each of `group_count` groups of lights at each own probe (worker/pass/groups.h); the groups' names are
     * borrowed. NULL: light is not separated by groups */
    const struct kiln_probe_group *groups;
    size_t group_count;
    char *const *group_names;
    /* light paths that this rank has traced for probes (bake/volume/probe_paths.h), and those that Embree traced for a
     * device
     */
    uint64_t paths, paths_on_host;
};

#endif
