/* Packed radiosity, 8 bytes a point: three unsigned floats of 21 bits, which are 32-bit floats without the sign and the
 * last 10 bits. worker/scene/radiosity.h packs them and describes the loss. */
#ifndef KILN_SHADERS_SHARED_RADIOSITY_H
#define KILN_SHADERS_SHARED_RADIOSITY_H

#include "shaders/shared/language.h"

#define KILN_RADIOSITY_BITS 21
#define KILN_RADIOSITY_MASK 0x1fffffu
#define KILN_RADIOSITY_DROPPED 10

/* Bits of a channel's float, from the lower and upper 32 bits of the packed word: red in bits 0 to 20, green in 21 to
 * 41, blue in 42 to 62. */
KILN_FUNCTION KILN_U32 kiln_radiosity_red(KILN_U32 low)
{
    return (low & KILN_RADIOSITY_MASK) << KILN_RADIOSITY_DROPPED;
}
KILN_FUNCTION KILN_U32 kiln_radiosity_green(KILN_U32 low, KILN_U32 high)
{
    return ((low >> 21 | high << 11) & KILN_RADIOSITY_MASK) << KILN_RADIOSITY_DROPPED;
}
KILN_FUNCTION KILN_U32 kiln_radiosity_blue(KILN_U32 high)
{
    return (high >> 10 & KILN_RADIOSITY_MASK) << KILN_RADIOSITY_DROPPED;
}

#endif
