/* Compiles GLSL to SPIR-V 1.5, for Vulkan 1.2, by libglslang. All functions are thread-safe. */
#ifndef KILN_SHADERS_COMPILE_GLSL_H
#define KILN_SHADERS_COMPILE_GLSL_H

#include <cstdint>
#include <string>
#include <vector>

namespace kiln
{

/* A kernel and how it is to be compiled. */
struct kernel {
    std::string name;
    std::string stage; /* comp, rgen, rchit, rahit or rmiss */
    std::string file;
    std::vector<std::string> definitions; /* NAME or NAME=VALUE */
};

/* Begins and ends the use of libglslang by the process. */
class compiler
{
  public:
    /* Files that sources include are looked for in `root`. */
    explicit compiler(std::string root);
    ~compiler();
    compiler(const compiler &) = delete;
    compiler &operator=(const compiler &) = delete;

    /* Returns the preprocessed text without empty lines. Two kernels with the same text and stage compile to the same
     * words. Throws std::runtime_error with the compiler's messages. */
    std::string preprocess(const kernel &k);
    /* The words of SPIR-V, with names. Throws likewise. */
    std::vector<uint32_t> compile(const kernel &k);

  private:
    std::string root;
};

/* Removes debug information: names, sources and lines. */
std::vector<uint32_t> strip(const std::vector<uint32_t> &words);

/* Finds the specialisation constants that the module uses: bit i is set if constant i is not only declared. A literal
 * equal to its id also sets the bit. */
uint32_t constants_asked(const std::vector<uint32_t> &words);

} // namespace kiln

#endif
