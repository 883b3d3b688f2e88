/* Units of light: determines whether the numbers of a bake are radiometric or photometric, and names their units.
 *
 * kiln does not convert: lights in watts give irradiance in W/m2, lights in lumens give lux. --units decides, or else
 * the file: `scenes[i].extras.units` or `asset.extras.units` ("radiometric" or "photometric"). If there are punctual
 * lights, the name of the exporter decides: Blender's multiplies watts by 683 lm/W unless it is told not to. Otherwise
 * the scene counts as radiometric. glTF defines all light as photometric, but files with other numbers are common. */
#ifndef KILN_COORDINATOR_FIELD_UNITS_H
#define KILN_COORDINATOR_FIELD_UNITS_H

#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

struct kiln_units {
    const char *kind;            /* "radiometric" or "photometric" */
    const char *irradiance;      /* "W m-2" or "lx", for files */
    const char *irradiance_text; /* "W/m2" or "lx", for messages */
    const char *radiance;        /* "W m-2 sr-1" or "cd m-2" */
    const char *intensity;       /* "W sr-1" or "cd" */
    const char *flux;            /* "W" or "lm" */
};

/* Determines the units of a scene. `choice`: the job's setting (enum kiln_units_choice). Never NULL. */
const struct kiln_units *kiln_units_of(int choice, const struct kiln_scene *scene);

/* The reason for these units, as text. */
const char *kiln_units_reason(int choice, const struct kiln_scene *scene);

/* The units with this `kind`; radiometric for any other text and for NULL. */
const struct kiln_units *kiln_units_named(const char *kind);

#endif
