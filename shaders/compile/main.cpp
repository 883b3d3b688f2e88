/* Makes all kernels of a list when kiln is built: SPIR-V, compressed by zstd, and the tables by which C finds it.
 *
 *     kiln_compile ROOT LIST FOLDER [FILE]
 *
 * LIST has a kernel a line: NAME STAGE PLACE SOURCE DEFINITION... ROOT is what includes are relative to. Made are
 *
 *     FOLDER/modules.h         const struct gpu_code kiln_code_NAME (worker/backend/vulkan/gpu/code.h) of each
 *     FOLDER/modules.c         the same, by modules.bin, which has the compressed modules whose PLACE is `program`
 *     FOLDER/NAME.spv          the module as kiln has it
 *     FOLDER/named/NAME.spv    the same with names; named/NAME.key tells what it was made of
 *     FILE                     the compressed modules whose PLACE is `file`; C has its size and hash
 *
 * A kernel whose text after preprocessing is what it was, with the same program here, is not compiled again. */
#include "shaders/compile/glsl.h"

#include <xxhash.h>
#include <zstd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace
{

namespace fs = std::filesystem;

/* Higher levels win 14 % and take fifteen times as long. */
constexpr int ZSTD_LEVEL = 9;
/* How the file of modules begins. */
constexpr char MAGIC[] = "KILNSPV1";

struct module {
    kiln::kernel kernel;
    bool in_file = false;
    std::string packed; /* compressed */
    size_t bytes = 0;   /* of the words */
    uint32_t asked = 0;
};

/* ---- files ---- */

/* Empty where there is none. */
std::string read(const fs::path &path)
{
    std::ifstream file(path, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    return file ? text.str() : std::string();
}

/* Writes only a file that changes, so that nothing is made anew for one that does not. */
void write(const fs::path &path, const std::string &bytes)
{
    if (fs::exists(path) && read(path) == bytes)
        return;
    std::ofstream file(path, std::ios::binary | std::ios::trunc);
    file << bytes;
    if (!file.flush())
        throw std::runtime_error(path.string() + ": the file cannot be written");
}

std::string bytes_of(const std::vector<uint32_t> &words)
{
    return std::string(reinterpret_cast<const char *>(words.data()), words.size() * sizeof(uint32_t));
}

std::vector<uint32_t> words_of(const std::string &bytes)
{
    std::vector<uint32_t> words(bytes.size() / sizeof(uint32_t));
    std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char *>(words.data()));
    return words;
}

/* The modules of the list. */
std::vector<module> read_list(const fs::path &path)
{
    std::istringstream lines(read(path));
    std::vector<module> modules;
    for (std::string line; std::getline(lines, line);) {
        std::istringstream cells(line);
        module m;
        std::string place;
        cells >> m.kernel.name >> m.kernel.stage >> place >> m.kernel.file;
        if (!cells)
            throw std::runtime_error(path.string() + ": '" + line + "' is not NAME STAGE PLACE SOURCE DEFINITION...");
        m.in_file = place == "file";
        for (std::string definition; cells >> definition;)
            m.kernel.definitions.push_back(definition);
        modules.push_back(m);
    }
    return modules;
}

/* ---- a module ---- */

std::string hex(const XXH128_hash_t &hash)
{
    char text[36];
    (void)std::snprintf(text, sizeof text, "%016llx%016llx", static_cast<unsigned long long>(hash.high64),
                        static_cast<unsigned long long>(hash.low64));
    return text;
}

/* The words with names: as they were made before of the same, or anew. */
std::vector<uint32_t> make_words(kiln::compiler &compiler, const kiln::kernel &k, const std::string &self,
                                 const fs::path &folder)
{
    const fs::path words = folder / (k.name + ".spv"), key = folder / (k.name + ".key");
    const std::string text = self + k.stage + "\n" + compiler.preprocess(k);
    const std::string hash = hex(XXH3_128bits(text.data(), text.size()));
    if (read(key) == hash && fs::exists(words))
        return words_of(read(words));
    fs::remove(key);
    const std::vector<uint32_t> made = compiler.compile(k);
    write(words, bytes_of(made));
    write(key, hash);
    return made;
}

std::string pack(const std::string &bytes)
{
    std::string packed(ZSTD_compressBound(bytes.size()), '\0');
    const size_t size = ZSTD_compress(packed.data(), packed.size(), bytes.data(), bytes.size(), ZSTD_LEVEL);
    if (ZSTD_isError(size))
        throw std::runtime_error(std::string("zstd: ") + ZSTD_getErrorName(size));
    packed.resize(size);
    return packed;
}

void make(kiln::compiler &compiler, module &m, const std::string &self, const fs::path &folder)
{
    const std::vector<uint32_t> named = make_words(compiler, m.kernel, self, folder / "named");
    const std::string bytes = bytes_of(kiln::strip(named));
    write(folder / (m.kernel.name + ".spv"), bytes);
    m.bytes = bytes.size();
    m.asked = kiln::constants_asked(named);
    m.packed = pack(bytes);
}

/* By all of the machine's cores. Throws what the first that failed has thrown. */
void make_all(kiln::compiler &compiler, std::vector<module> &modules, const std::string &self, const fs::path &folder)
{
    std::atomic<size_t> next{0};
    std::exception_ptr failed;
    std::mutex mutex;
    std::vector<std::thread> threads;
    const auto work = [&] {
        for (size_t i = next++; i < modules.size(); i = next++) {
            try {
                make(compiler, modules[i], self, folder);
            } catch (...) {
                const std::lock_guard<std::mutex> lock(mutex);
                failed = failed ? failed : std::current_exception();
                next = modules.size();
            }
        }
    };
    for (unsigned i = 0; i < std::max(1u, std::thread::hardware_concurrency()); i++)
        threads.emplace_back(work);
    for (std::thread &thread : threads)
        thread.join();
    if (failed)
        std::rethrow_exception(failed);
}

/* ---- the tables ---- */

void write_header(const std::vector<module> &modules, const fs::path &folder)
{
    std::ostringstream h;
    h << "#include \"worker/backend/vulkan/gpu/code.h\"\n\n";
    for (const module &m : modules)
        h << "extern const struct gpu_code kiln_code_" << m.kernel.name << ";\n";
    write(folder / "modules.h", h.str());
}

/* The modules one behind the other, in the program or in the file. */
void write_tables(const std::vector<module> &modules, const fs::path &folder, const fs::path &file)
{
    std::string program, apart = MAGIC;
    std::ostringstream c;
    c << "#include \"" << (folder / "modules.h").string() << "\"\n\n"
      << "extern const unsigned char kiln_modules[];\n"
      << "__asm__(\".pushsection .rodata\\nkiln_modules: .incbin \\\"" << (folder / "modules.bin").string()
      << "\\\"\\n.popsection\");\n";
    for (const module &m : modules) {
        std::string &to = m.in_file ? apart : program;
        c << "const struct gpu_code kiln_code_" << m.kernel.name << " = {"
          << (m.in_file ? "0" : "kiln_modules + " + std::to_string(to.size())) << ", " << (m.in_file ? to.size() : 0)
          << ", " << m.packed.size() << ", " << m.bytes << ", " << m.asked << "u};\n";
        to += m.packed;
    }
    write(folder / "modules.bin", program);
    if (!file.empty()) {
        const XXH128_hash_t hash = XXH3_128bits(apart.data(), apart.size());
        c << "const struct gpu_code_file kiln_code_file = {" << apart.size() << ", " << hash.low64 << "u, "
          << hash.high64 << "u};\n";
        write(file, apart);
    }
    write(folder / "modules.c", c.str());
}

/* A hash of this program: what it makes may be another's. */
std::string identity()
{
    const std::string program = read("/proc/self/exe");
    return hex(XXH3_128bits(program.data(), program.size())) + "\n";
}

} // namespace

int main(int count, char **arguments)
{
    if (count < 4) {
        std::cerr << "kiln_compile ROOT LIST FOLDER [FILE]\n";
        return 64;
    }
    try {
        const fs::path folder = arguments[3];
        kiln::compiler compiler(arguments[1]);
        std::vector<module> modules = read_list(arguments[2]);
        fs::create_directories(folder / "named");
        make_all(compiler, modules, identity(), folder);
        write_header(modules, folder);
        write_tables(modules, folder, count > 4 ? arguments[4] : "");
    } catch (const std::exception &error) {
        std::cerr << error.what() << "\n";
        return 1;
    }
    return 0;
}
