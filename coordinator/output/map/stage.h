/* A map stage is one operation on an object's lightmap, between the gathered points and the image: measure, mean
 * error, walls, denoise, fill, borders, seams, directions, dilate. Each is a struct in a file of its own. The table of
 * all, in the order in which they run, is stages.c; the writer of lightmaps walks it and knows no stage by name.
 *
 * To add a stage, write such a file, a declaration at the end of this header, and a row of the table. Its struct lists
 * the inputs besides light, area, coverage and state, which every map has. A field in that list is sent with the texels
 * even if no lightmap publishes it. Features that no stage reads are not computed and cost nothing.
 *
 * A stage has the whole map of one object, or a band of it. It may read neighbours of a texel; `chart` tells which of
 * them belong to the same chart. It is collective only if the map is in bands, and then calls bands.h only. A stage
 * must be deterministic and depend on its object only. Several objects are processed at once, each by its own threads;
 * maps in bands are processed by all ranks, one map after the other.
 *
 * Maps of objects that touch others wait for one another before the first stage with `after_joining`. Their common
 * seams are solved there (joined.h). The later stages find the solution in `joined` of the work. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_STAGE_H
#define KILN_COORDINATOR_OUTPUT_MAP_STAGE_H

#include "coordinator/output/map/layers.h"
#include "coordinator/output/map/lightmap_report.h"
#include "coordinator/output/output.h"

struct kiln_chart_graph;  /* chart_graph.h */
struct kiln_chart_graphs; /* chart_graphs.h */
struct kiln_joined;       /* joined.h */
struct kiln_regression_device;

/* Inputs of a stage besides fields. They are computed just before the first stage that reads them; positions and
 * normals, however, are sent with the texels. */
enum kiln_map_feature {
    KILN_MAP_CHARTS = 1,   /* the chart graph, and `chart` of the map */
    KILN_MAP_NEAREST = 2,  /* `nearest` of the work */
    KILN_MAP_POSITION = 4, /* 3 planes from layers->position: centroid of the covered part, m from the scene's centre */
    KILN_MAP_NORMAL = 8    /* 3 planes from layers->normal: mean shading normal there, unit, world */
};

/* Ghosts of a map (ghosts.h), in the order of their arrival. */
struct kiln_map_ghosts {
    size_t count, capacity, size; /* size: bytes of a record */
    uint8_t *records;             /* struct kiln_texel_record (texel_record.h), of valid points */
};

/* Data of the stages: the map of one object. Borrowed, but for `graph`, `nearest` and ghosts. These, `denoising`,
 * `shared` and `next` begin as zero. */
struct kiln_map_work {
    const struct kiln_bake_result *result;
    const struct kiln_output_params *params;
    const struct kiln_layers *layers; /* the planes of the map */
    const uint32_t *reads;            /* planes of the fields that the running stage names: a row of layers->reads */
    uint32_t object;                  /* number of the lightmap */
    bool in_bands;                    /* all ranks have some of it (bands.h) */
    struct kiln_map *map;
    struct kiln_regression_device *device; /* device that denoises; NULL: the host does */
    struct kiln_lightmap_report *report;   /* each stage fills in what it measures */
    struct kiln_chart_graphs *graphs;      /* source of chart graphs */
    const struct kiln_chart_graph *graph;  /* KILN_MAP_CHARTS */
    struct kiln_map_ghosts ghosts;         /* if objects that touch are denoised */
    const struct kiln_joined *joined;      /* if the object touches others, after joining; else NULL */
    double denoising;                      /* seconds of denoising not yet accounted for; run_maps.c */
    float shared;                          /* part of the squared error common to neighbours; mean_error.c, else 0 */
    size_t next;                           /* the stage that runs next */
    /* KILN_MAP_NEAREST: for every texel, the surface texel whose values it gets when the map is dilated:
     * kiln_nearest_texels with KILN_TEXEL_FILLED, until the stage "borders" changes it */
    uint32_t *nearest;
};

struct kiln_map_stage {
    const char *name;
    bool after_joining;                                      /* see above */
    bool (*wanted)(const struct kiln_output_params *params); /* NULL: always */
    uint32_t features;                                       /* of enum kiln_map_feature, or'ed */
    /* names of the fields that the stage reads besides direct light, indirect light and the error (map.h). `reads` of
     * the work has their planes in this order. Planes of fields, positions and normals have values in gathered texels;
     * they are filled and dilated like all planes */
    const char *fields[KILN_MAP_STAGE_FIELDS];
    const char *if_any; /* name of an optional field, which not all bakes have, at KILN_MAP_IF_ANY; NULL: none */
    /* tells whether the stage takes long on a map, whatever its texels are; NULL: never */
    bool (*is_long)(const struct kiln_map_work *work);
    int (*run)(struct kiln_map_work *work, struct kiln_error *error);
};

extern const struct kiln_map_stage kiln_map_stage_measure, kiln_map_stage_mean_error, kiln_map_stage_walls,
    kiln_map_stage_denoise, kiln_map_stage_fill, kiln_map_stage_borders, kiln_map_stage_seams,
    kiln_map_stage_directions, kiln_map_stage_dilate;

#endif
