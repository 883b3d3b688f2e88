/* Links to lightmaps, and vertex colours: the additions of an exported glTF to its source. Private to
 * coordinator/export. */
#ifndef KILN_COORDINATOR_EXPORT_GLB_LIGHTMAP_H
#define KILN_COORDINATOR_EXPORT_GLB_LIGHTMAP_H

#include "coordinator/export/glb_build.h"

#define KILN_LIGHTMAP_EXTENSION "KILN_lightmap"

/* Sets `link` (borrowed) as a node's extensions.KILN_lightmap, and as extras.kiln_lightmap if extras is an object or
 * absent. */
void kiln_export_link(struct kiln_glb_build *b, json_t *node, json_t *link);
/* Sets the root's extension, and lists the extension as used. */
void kiln_export_root(struct kiln_glb_build *b, json_t *plan);

/* The first adds an accessor of `count` RGB colours and returns its index; the second adds `count` white colours. */
uint32_t kiln_export_colors(struct kiln_glb_build *b, const float (*colors)[3], size_t count);
uint32_t kiln_export_white(struct kiln_glb_build *b, size_t count);

#endif
