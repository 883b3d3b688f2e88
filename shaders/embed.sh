#!/bin/sh
# embed.sh NAME FILE HEADER: a header in which C finds the words of the SPIR-V in FILE as kiln_spirv_NAME. The assembler
# puts them there: as numbers in C they take longer to compile than all else that includes them.
set -e
cat > "$3" <<END
extern const uint32_t kiln_spirv_$1[$(($(stat -c %s "$2") / 4))];
__asm__(".pushsection .rodata\n"
        ".balign 4\n"
        "kiln_spirv_$1:\n"
        ".incbin \"$2\"\n"
        ".popsection\n");
END
