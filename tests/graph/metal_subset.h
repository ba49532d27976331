// Declarations of what printed Metal shading language uses, so that clang can check a text without Apple's SDK.
// Metal Shading Language Specification 4: vectors (2.2), textures (6.12), math (6.5), common and geometric functions (6.3, 6.6).
#define thread
typedef unsigned int uint;
#define VECTORS(T)                                    \
  typedef T T##2 __attribute__((ext_vector_type(2))); \
  typedef T T##3 __attribute__((ext_vector_type(3))); \
  typedef T T##4 __attribute__((ext_vector_type(4))); \
  T##2 make_##T##2(T);                                \
  T##2 make_##T##2(T, T);                             \
  T##3 make_##T##3(T);                                \
  T##3 make_##T##3(T, T, T);                          \
  T##3 make_##T##3(T##2, T);                          \
  T##4 make_##T##4(T);                                \
  T##4 make_##T##4(T, T, T, T);                       \
  T##4 make_##T##4(T##2, T, T);                       \
  T##4 make_##T##4(T##2, T##2);                       \
  T##4 make_##T##4(T##3, T);
VECTORS(float)
VECTORS(int)
VECTORS(uint)
// Constructors: clang's own vectors have none, Metal's do.
#define float2(...) make_float2(__VA_ARGS__)
#define float3(...) make_float3(__VA_ARGS__)
#define float4(...) make_float4(__VA_ARGS__)
#define int4(...) make_int4(__VA_ARGS__)
#define uint2(...) make_uint2(__VA_ARGS__)
struct float4x4 {
  float4x4(float4, float4, float4, float4);
};
float4 operator*(float4x4, float4);
namespace metal {
struct level {
  explicit level(float);
};
struct sampler {};
template <typename T>
struct texture2d {
  float4 read(uint2, uint) const;
  float4 sample(sampler, float2, level) const;
};
#define FUNCTIONS(T)  \
  T abs(T);           \
  T floor(T);         \
  T exp(T);           \
  T log(T);           \
  T log2(T);          \
  T sqrt(T);          \
  T sign(T);          \
  T dfdx(T);          \
  T dfdy(T);          \
  T min(T, T);        \
  T max(T, T);        \
  T clamp(T, T, T);   \
  T mix(T, T, T);     \
  float dot(T, T);
FUNCTIONS(float)
FUNCTIONS(float2)
FUNCTIONS(float3)
FUNCTIONS(float4)
}  // namespace metal
using namespace metal;
