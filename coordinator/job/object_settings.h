/* What a user says of single objects: in the document, as a node's `extras`, and in the job, by rules with patterns of
 * names.
 *
 * The keys, the same in both places ('-' and '_' are the same in a document):
 *   density-scale: FACTOR      texels a metre, times this; 0.001 to 1000
 *   lightmap-size: TEXELS      the object's lightmap is N x N; 1 to 32768
 *   exclude: true              the object is not in the bake at all
 *   role: both | caster-only | receiver-only
 *                              caster-only: stops and reflects light, but its lightmap is not published, so that coarse
 * texels do (a quarter of the density, unless density-scale or lightmap-size say otherwise); receiver-only: has a
 *                              lightmap, but no ray meets it, and it lights nothing
 *   sides: one | two           which sides of its double-sided surfaces have their lightmap published
 *
 * In a document: node.extras.kiln = {"exclude": true}, or node.extras["kiln-exclude"] = true, which is what custom
 * properties of modelling programs become. They are the node's own: its children do not inherit them. A job's rules
 * come after the document's, later rules after earlier ones, key by key. A rule's pattern is a shell glob (*, ?, [a-z])
 * and stands for every object whose name, as the file has it or as its lightmap is called, matches in whole.
 *
 * As text, rules are a JSON object: {"Chair*": {"density-scale": 2}, "Ground": {"role": "caster-only"}}. */
#ifndef KILN_COORDINATOR_JOB_OBJECT_SETTINGS_H
#define KILN_COORDINATOR_JOB_OBJECT_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include <jansson.h>

#include "worker/base/status.h"

enum kiln_object_role { KILN_ROLE_UNSAID = 0, KILN_ROLE_BOTH, KILN_ROLE_CASTER_ONLY, KILN_ROLE_RECEIVER_ONLY };
enum kiln_object_sides { KILN_SIDES_UNSAID = 0, KILN_SIDES_ONE, KILN_SIDES_TWO };
enum kiln_object_exclude { KILN_EXCLUDE_UNSAID = 0, KILN_EXCLUDE_NO, KILN_EXCLUDE_YES };

/* All zero: nothing is said. */
struct kiln_object_settings {
    double density_scale;
    uint32_t lightmap_size;
    uint8_t role, sides, exclude; /* the enums above */
};

enum { KILN_RULES_LIMIT = 100000 }; /* bytes of all rules as text: they are an argument of the importing process */

/* Reads one key. *known tells whether there is one of that name; otherwise nothing is read. A value that will not do
 * fails with `status` and a sentence that begins with `where`. */
int kiln_object_settings_read(struct kiln_object_settings *settings, const char *key, const json_t *value,
                              const char *where, int status, bool *known, struct kiln_error *error);
/* The known key that is most like `key`. */
const char *kiln_object_settings_nearest(const char *key);

#endif
