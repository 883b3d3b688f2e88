/* Settings of single objects. They come from the scene file, in the `extras` of a node, and from the job, as rules with
 * patterns of object names.
 *
 * The keys are the same in both places; in a scene file '_' may replace '-':
 *
 * - density-scale: FACTOR. Factor on the texel density, 0.001 to 1000.
 *
 * - lightmap-size: TEXELS. The object's lightmap is N x N, 1 to 32768.
 *
 * - exclude: true. The object is not part of the bake.
 *
 * - role: both | caster-only | receiver-only. A caster-only object blocks and reflects light, but its lightmap is not
 *   published and therefore coarse: a quarter of the density, unless density-scale or lightmap-size is given. A
 *   receiver-only object has a lightmap, but no ray hits it, and it lights nothing.
 *
 * - sides: one | two. The sides of the object's double-sided surfaces whose lightmaps are published.
 *
 * In a scene file: node.extras.kiln = {"exclude": true}, or node.extras["kiln-exclude"] = true, which custom properties
 * of modelling programs become. They apply to that node only, not to its children. Rules of the job override the scene
 * file, and later rules earlier ones, key by key. The pattern of a rule is a shell glob (*, ?, [a-z]) and applies to
 * every object whose name in the file, or the name of whose lightmap, matches completely.
 *
 * Rules are stored as a JSON object: {"Chair*": {"density-scale": 2}, "Ground": {"role": "caster-only"}}. */
#ifndef KILN_COORDINATOR_JOB_OBJECT_SETTINGS_H
#define KILN_COORDINATOR_JOB_OBJECT_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include <jansson.h>

#include "worker/base/status.h"
#include "worker/scene/object_settings.h"

enum {
    KILN_RULES_LIMIT = 100000
}; /* most bytes of all rules as text, since they are a command line argument of the import process */

/* Reads one key. *known tells whether there is a key of that name; otherwise nothing is read. For an invalid value
 * returns `status` with a message that begins with `where`. */
int kiln_object_settings_read(struct kiln_object_settings *settings, const char *key, const json_t *value,
                              const char *where, int status, bool *known, struct kiln_error *error);
/* The known key with the least edit distance from `key`. */
const char *kiln_object_settings_nearest(const char *key);

#endif
