/* Textures that have one colour everywhere become factors of their materials, so that the backends need not look them
 * up. */
#ifndef KILN_COORDINATOR_IMPORT_CONSTANT_TEXTURES_H
#define KILN_COORDINATOR_IMPORT_CONSTANT_TEXTURES_H

#include "coordinator/scene/builder.h"

/* Multiplies each such texture of emission, base colour or transmission into its material's factor, and takes it off
 * the material. The texels stay in the scene, since a normal map may use them too. Returns how many uses were
 * replaced. */
size_t kiln_fold_constant_textures(struct kiln_builder *builder);

#endif
