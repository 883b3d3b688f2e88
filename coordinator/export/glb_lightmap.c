#include "coordinator/export/glb_lightmap.h"

#include <string.h>

void kiln_export_link(struct kiln_glb_build *b, json_t *node, json_t *link)
{
    json_t *extensions = kiln_glb_object(b, node, "extensions"), *extras = kiln_glb_object(b, node, "extras");
    if (extensions != NULL)
        kiln_glb_set(b, extensions, KILN_LIGHTMAP_EXTENSION, json_incref(link));
    if (extras != NULL)
        kiln_glb_set(b, extras, "kiln_lightmap", json_incref(link));
}

void kiln_export_root(struct kiln_glb_build *b, json_t *plan)
{
    json_t *extensions = kiln_glb_object(b, b->root, "extensions");
    if (extensions != NULL)
        kiln_glb_set(b, extensions, KILN_LIGHTMAP_EXTENSION, json_incref(json_object_get(plan, "root")));
    kiln_glb_use(b, KILN_LIGHTMAP_EXTENSION);
}

uint32_t kiln_export_colors(struct kiln_glb_build *b, const float (*colors)[3], size_t count)
{
    unsigned char *bytes;
    const uint32_t view = kiln_glb_view(b, count * sizeof *colors, 0, KILN_GLTF_ARRAY_BUFFER, &bytes);
    if (bytes != NULL)
        memcpy(bytes, colors, count * sizeof *colors);
    return kiln_glb_append(b, b->root, "accessors",
                           json_pack("{s:i, s:i, s:I, s:s}", "bufferView", (int)view, "componentType", KILN_GLTF_FLOAT,
                                     "count", (json_int_t)count, "type", "VEC3"));
}

uint32_t kiln_export_white(struct kiln_glb_build *b, size_t count)
{
    unsigned char *bytes;
    const uint32_t view = kiln_glb_view(b, count * 4, 0, KILN_GLTF_ARRAY_BUFFER, &bytes);
    if (bytes != NULL)
        memset(bytes, 255, count * 4);
    return kiln_glb_append(b, b->root, "accessors",
                           json_pack("{s:i, s:i, s:I, s:s, s:b}", "bufferView", (int)view, "componentType",
                                     KILN_GLTF_UNSIGNED_BYTE, "count", (json_int_t)count, "type", "VEC4", "normalized",
                                     1));
}
