/* What a bake's numbers are measured in: the one place that knows.
 *
 * kiln computes with numbers and changes none: lights in watts give irradiance in W/m2, lights in lumens give it in
 * lux. Which of the two a scene has is asked for (--units) or read from the file: from `scenes[i].extras.units` or
 * `asset.extras.units`
 * ("radiometric" or "photometric"), or, when there are punctual lights, from the exporter's name: Blender's multiplies
 * their watts by 683 lm/W unless it is told not to. glTF calls all light photometric, but files with plain numbers
 * abound: without a word in the file it is taken as radiometric. */
#ifndef KILN_COORDINATOR_FIELD_UNITS_H
#define KILN_COORDINATOR_FIELD_UNITS_H

#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

struct kiln_units {
    const char *kind;            /* "radiometric" or "photometric" */
    const char *irradiance;      /* "W m-2" or "lx": as files have it */
    const char *irradiance_text; /* "W/m2" or "lx": as people read it */
    const char *radiance;        /* "W m-2 sr-1" or "cd m-2" */
    const char *intensity;       /* "W sr-1" or "cd" */
    const char *flux;            /* "W" or "lm" */
};

/* `choice` is the job's (enum kiln_units_choice). Never NULL. */
const struct kiln_units *kiln_units_of(int choice, const struct kiln_scene *scene);

/* Why, in words: "asked for", "Blender's exporter writes lights so", ... */
const char *kiln_units_reason(int choice, const struct kiln_scene *scene);

/* Those whose `kind` is this; radiometric for any other word and for NULL. */
const struct kiln_units *kiln_units_named(const char *kind);

#endif
