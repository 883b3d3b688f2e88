#include "coordinator/output/provenance.h"

#include <jansson.h>

bool kiln_provenance_seed(const char *text, int64_t *seed)
{
    json_t *all = text == NULL ? NULL : json_loads(text, 0, NULL);
    const json_t *found = json_object_get(all, "seed");
    if (!json_is_integer(found))
        found = json_object_get(json_object_get(all, "settings"), "seed");
    const bool there = json_is_integer(found);
    *seed = json_integer_value(found);
    json_decref(all);
    return there;
}
