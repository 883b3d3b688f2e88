/* How a dispatch with more workgroups than a device takes at once is folded into z; for gpu/submit.c and
 * shaders/main.glsl. */
#ifndef KILN_SHADERS_FOLD_H
#define KILN_SHADERS_FOLD_H

#define KILN_FOLD_Y 32768u

#endif
