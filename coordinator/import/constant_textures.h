/* Replacement of constant textures by factors of their materials, so that the backends need not look these textures up.
 */
#ifndef KILN_COORDINATOR_IMPORT_CONSTANT_TEXTURES_H
#define KILN_COORDINATOR_IMPORT_CONSTANT_TEXTURES_H

#include "coordinator/scene/builder.h"

/* Multiplies each constant texture of emission, base colour or transmission into its material's factor, and removes it
 * from the material. The texels stay in the scene, since a normal map may use them too. Returns the number of uses
 * replaced. */
size_t kiln_fold_constant_textures(struct kiln_builder *builder);

#endif
