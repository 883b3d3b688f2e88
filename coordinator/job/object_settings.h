/* Settings for single objects. A user gives them in the document, as a node's `extras`, or in the job, as rules with
 * patterns of names.
 *
 * The keys, the same in both places ('-' and '_' are equivalent in a document):
 *   density-scale: FACTOR      factor on the texels a metre; 0.001 to 1000
 *   lightmap-size: TEXELS      the object's lightmap is N x N; 1 to 32768
 *   exclude: true              the object is left out of the bake
 *   role: caster-only          it blocks and reflects light, but its lightmap is not published; it has a quarter of the
 *                              density, unless density-scale or lightmap-size is given
 *   role: receiver-only        it has a lightmap, but no ray hits it, so it lights nothing
 *   role: both                 neither restriction
 *   sides: one | two           which sides of its double-sided surfaces have a published lightmap
 *
 * In a document: node.extras.kiln = {"exclude": true}, or node.extras["kiln-exclude"] = true, as custom properties of
 * modelling programs are exported. Settings apply to the node itself, not to its children. Rules of the job come after
 * the document, later rules after earlier ones, key by key. A rule's pattern is a shell glob (*, ?, [a-z]). It matches
 * every object whose whole name matches, either as in the file or as its lightmap is called.
 *
 * As text, rules are a JSON object: {"Chair*": {"density-scale": 2}, "Ground": {"role": "caster-only"}}. */
#ifndef KILN_COORDINATOR_JOB_OBJECT_SETTINGS_H
#define KILN_COORDINATOR_JOB_OBJECT_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include <jansson.h>

#include "worker/base/status.h"

enum kiln_object_role { KILN_ROLE_UNSET = 0, KILN_ROLE_BOTH, KILN_ROLE_CASTER_ONLY, KILN_ROLE_RECEIVER_ONLY };
enum kiln_object_sides { KILN_SIDES_UNSET = 0, KILN_SIDES_ONE, KILN_SIDES_TWO };
enum kiln_object_exclude { KILN_EXCLUDE_UNSET = 0, KILN_EXCLUDE_NO, KILN_EXCLUDE_YES };

/* All zero: nothing is set. */
struct kiln_object_settings {
    double density_scale;
    uint32_t lightmap_size;
    uint8_t role, sides, exclude; /* the enums above */
};

enum { KILN_RULES_LIMIT = 100000 }; /* bytes of all rules as text, at most: they are an argument of the import child */

/* Reads one key. *known tells whether the key exists; if not, nothing is read. For an invalid value, fails with
 * `status` and a sentence that begins with `where`. */
int kiln_object_settings_read(struct kiln_object_settings *settings, const char *key, const json_t *value,
                              const char *where, int status, bool *known, struct kiln_error *error);
/* The known key most similar to `key`. */
const char *kiln_object_settings_nearest(const char *key);

#endif
