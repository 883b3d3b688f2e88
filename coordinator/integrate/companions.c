#include "coordinator/integrate/companion.h"

#define STRUCT(name) &kiln_companion_##name,

const struct kiln_companion *const kiln_companions[] = {KILN_COMPANION_LIST(STRUCT) NULL};
