/* Which store is compiled in: where the light of surfaces lives, and the way to it from a ray's hit.
 * worker/store/store.h says what a store is. A row for each; those of C and of the kernels are in worker/store/store.h
 * and shaders/surface.glsl. */
#ifndef KILN_SHADERS_SHARED_STORE_H
#define KILN_SHADERS_SHARED_STORE_H

#define KILN_STORE_LIGHTMAP 1 /* shaders/shared/store_lightmap.h */

#define KILN_STORE KILN_STORE_LIGHTMAP

#endif
